"""The observation list, and how far an arc is free of what it holds."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.errors import InputError
from ndtorch.navigation import ObservationList, Pose, Ranges
from ndtorch.navigation.mapping.observations import Observations, arc_coordinates, free_length, path_is_free
from tests.navigation.mapping.test_grid_map import poses, random_run, ranges_of


def test_list_keeps_the_newest_and_forgets():
    module = ObservationList(dt=0.5, capacity=4, lifetime=2.0)
    state = None
    for t in range(3):
        seen, state = module(ranges_of([[[1.0 + t, 0.0], [1.0, 1.0]]]), poses([0.0, 0.0, 0.0]), state)
    assert seen.x.tolist() == [3.0, 1.0, 2.0, 1.0]
    wanted = [1.0, 1.0, math.exp(-0.25), math.exp(-0.25)]
    assert seen.weight.tolist() == pytest.approx(wanted)
    turned, _ = module(ranges_of([[[1.0, 0.0]]], [[False]]), poses([2.0, 3.0, math.pi / 2]))
    assert (turned.weight == 0).all()
    assert (float(turned.x[0]), float(turned.y[0])) == pytest.approx((2.0, 4.0))
    assert turned.seen_from[0].tolist() == pytest.approx([2.0, 3.0, math.pi / 2])


def test_list_chunks_and_batches():
    ranges, pose = random_run(5, 2, 3)
    module = ObservationList(dt=0.1, capacity=10)
    whole, _ = module(ranges, pose)
    state = None
    for t in (slice(0, 1), slice(1, 4), slice(4, 6)):
        _, state = module(Ranges(*(p[..., t, :] for p in ranges)), Pose(*(p[..., t] for p in pose)), state)
    for a, b in zip(whole, state, strict=True):
        assert torch.equal(a, b)
    assert whole.x.shape == (2, 3, 10)


def listed(points, weight=1.0):
    points = torch.tensor(points, dtype=torch.float64).reshape(-1, 2)
    ones = torch.ones(len(points), dtype=torch.float64)
    return Observations(points[:, 0], points[:, 1], weight * ones, ones, torch.zeros(len(points), 3))


HERE = Pose(*torch.zeros(3, dtype=torch.float64))


ARCS = torch.tensor([0.0, 1.0, -1.0, 2.0, -2.0], dtype=torch.float64)


@settings(max_examples=50, deadline=None)
@given(st.floats(-2, 2), st.floats(0.05, 1.2), st.floats(-0.5, 0.5))
def test_arc_coordinates_of_points_made_on_the_arc(curvature, along, aside):
    """Drive along the arc, step sideways, and read both numbers back."""
    if abs(curvature) > 1e-3 and abs(aside) > 0.45 / abs(curvature):
        return
    k = curvature if abs(curvature) > 1e-3 else 0.0
    x = math.sin(k * along) / k if k else along
    y = (1 - math.cos(k * along)) / k if k else 0.0
    heading = k * along
    point = torch.tensor([x - aside * math.sin(heading), y + aside * math.cos(heading)], dtype=torch.float64)
    found = arc_coordinates(point[0], point[1], torch.tensor(k, dtype=torch.float64))
    assert float(found[0]) == pytest.approx(along, abs=1e-6)
    assert float(found[1]) == pytest.approx(abs(aside), abs=1e-6)


def test_free_length_by_hand():
    wall = listed([[1.2, -0.2], [1.25, -0.1], [1.3, 0.0], [1.35, 0.1], [0.5, 0.0]])
    free = free_length(wall, HERE, ARCS)
    assert float(free[0]) == pytest.approx(1.2)  # the single one at 0.5 does not count
    assert free[3:].tolist() == [2.0, 2.0]  # tight turns pass the wall
    assert path_is_free(wall, HERE, ARCS, 1.0)[0]
    assert not path_is_free(wall, HERE, ARCS, 1.3)[0]
    assert free_length(wall, HERE, ARCS, enough=1.0)[0] == pytest.approx(0.5)
    assert free_length(listed([[1.2, 0.0]], 4.0), HERE, ARCS)[0] == pytest.approx(1.2)
    # Four that are spread over more than 0.3 m do not gather.
    assert free_length(listed([[0.8, 0.0], [1.0, 0.0], [1.2, 0.0], [1.4, 0.0]]), HERE, ARCS)[0] == 2.0
    # What is behind or beside the car does not matter.
    assert free_length(listed([[-0.5, 0.0], [0.8, 0.3]], 9.0), HERE, ARCS)[0] == 2.0


def plain_free_length(points, weights, k, half_width, farthest, enough, gather):
    inside = []
    for (x, y), w in zip(points, weights, strict=True):
        if k == 0:
            along, aside = x, abs(y)
        else:
            radius = math.hypot(x, y - 1 / k)
            along = math.atan2(k * x, 1 - k * y) / k
            aside = abs(radius - 1 / abs(k))
        if aside <= half_width and along > 0:
            inside.append((along, w))
    for start, _ in sorted(inside):
        if sum(w for along, w in inside if start <= along <= start + gather) >= enough:
            return min(start, farthest)
    return farthest


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_free_length_against_plain_loops(seed):
    generator = torch.Generator().manual_seed(seed)
    points = torch.rand(40, 2, generator=generator, dtype=torch.float64) * 4 - 2
    weight = torch.rand(40, generator=generator, dtype=torch.float64) * 2
    free = free_length(listed(points.tolist(), weight), HERE, ARCS, 0.3, 1.8, 2.0, 0.3)
    for k, found in zip(ARCS.tolist(), free.tolist(), strict=True):
        wanted = plain_free_length(points.tolist(), weight.tolist(), k, 0.3, 1.8, 2.0, 0.3)
        assert found == pytest.approx(wanted, abs=1e-9)


def test_free_length_follows_the_pose():
    wall = listed([[2.0, 3.0]], 5.0)
    pose = Pose(*torch.tensor([2.0, 1.5, math.pi / 2], dtype=torch.float64))
    assert float(free_length(wall, pose, ARCS)[0]) == pytest.approx(1.5)
    away = pose._replace(heading=-pose.heading)
    assert free_length(wall, away, ARCS)[0] == 2.0
    batch = Observations(*(torch.stack([p, p]) for p in wall))
    both = Pose(*(torch.stack([a, b]) for a, b in zip(pose, away, strict=True)))
    assert free_length(batch, both, ARCS)[:, 0].tolist() == pytest.approx([1.5, 2.0])


def test_bad_lists():
    with pytest.raises(InputError, match="dt"):
        ObservationList(dt=0.0)
    with pytest.raises(InputError, match="curvatures"):
        free_length(listed([[1.0, 0.0]]), HERE, torch.zeros(2, 2))
    for name in ("half_width", "farthest", "enough", "gather"):
        free_length(listed([[1.0, 0.0]]), HERE, ARCS, **{name: 1e-3})
        for value in (0.0, -1.0, math.nan):
            with pytest.raises(InputError, match=f"{name}={value}"):
                free_length(listed([[1.0, 0.0]]), HERE, ARCS, **{name: value})


def test_cars_in_a_batch_are_as_free_as_each_alone():
    generator = torch.Generator().manual_seed(3)
    points = torch.rand(2, 6, 40, 2, generator=generator, dtype=torch.float64) * 4 - 2
    weight = torch.rand(2, 6, 40, generator=generator, dtype=torch.float64) * 2
    turned = torch.linspace(-1, 1, 12, dtype=torch.float64).view(2, 6)
    seen = Observations(points[..., 0], points[..., 1], weight, torch.ones_like(weight), torch.zeros(2, 6, 40, 3))
    poses = Pose(turned / 3, turned / 4, turned)
    free = free_length(seen, poses, ARCS, 0.3, 1.8, 2.0, 0.3)
    assert free.shape == (2, 6, 5)
    for i in range(2):
        for j in range(6):
            one, pose = (
                Observations(*(part[i, j] for part in seen)),
                Pose(*(part[i, j] for part in (turned / 3, turned / 4, turned))),
            )
            assert torch.equal(free[i, j], free_length(one, pose, ARCS, 0.3, 1.8, 2.0, 0.3))
