"""The grid map, the log-odds map and the observation list."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.errors import InputError
from ndtorch.navigation import Grid, GridMap, ObservationList, Pose, Ranges, StereoRig
from ndtorch.navigation.certainty import certainty
from ndtorch.navigation.mapping import LogOdds
from ndtorch.navigation.observations import Observations, arc_coordinates, free_length, path_is_free
from ndtorch.navigation.odometry import to_body

RIG = StereoRig()
GRID = Grid(-1.0, 5.0, -3.0, 3.0)


def ranges_of(points, valid=None, rig=RIG):
    """Ranges of points of the body frame, `[..., T, n, 2]`."""
    points = torch.as_tensor(points, dtype=torch.float32)
    x, y = points.unbind(-1)
    left, right = torch.atan2(y - rig.baseline / 2, x), torch.atan2(y + rig.baseline / 2, x)
    valid = torch.ones(x.shape, dtype=torch.bool) if valid is None else torch.as_tensor(valid)
    return Ranges(torch.hypot(x, y - rig.baseline / 2), left, right, x, y, valid)


def poses(*values):
    return Pose(*torch.tensor(values, dtype=torch.float32).unbind(-1))


def random_run(seed, *batch, steps=6, count=3):
    generator = torch.Generator().manual_seed(seed)
    points = torch.rand(*batch, steps, count, 2, generator=generator) * torch.tensor([1.4, 1.6])
    points = points + torch.tensor([0.7, -0.8])
    pose = torch.rand(*batch, steps, 3, generator=generator) * torch.tensor([1.5, 1.0, 0.6])
    valid = torch.rand(*batch, steps, count, generator=generator) < 0.7
    return ranges_of(points, valid), Pose(*pose.unbind(-1))


def test_cells_against_fine_sampling_of_the_formula():
    """Mean of the printed certainty over every cell, from 5x5 points each, at a turned and shifted pose."""
    grid, fine = Grid(0.0, 3.0, -0.5, 2.5), 5
    ranges, pose = ranges_of([[[1.6, 0.3], [1.1, -0.2]]]), poses([0.4, 0.2, 0.5])
    cells, _ = GridMap(RIG, grid)(ranges, pose)
    place = (torch.arange(300 * fine, dtype=torch.float64) + 0.5) / (100 * fine)
    wanted = torch.zeros(300 * fine, 300 * fine, dtype=torch.float64)
    x, y = to_body(pose, place.unsqueeze(0), (place - 0.5).unsqueeze(1))
    for k in range(2):
        wanted += certainty(x, y, Ranges(*(part[0, k] for part in ranges)), RIG)
    wanted = wanted.reshape(300, fine, 300, fine).mean((1, 3))
    assert float(cells.sum()) == pytest.approx(float(wanted.sum()), rel=0.01)
    assert float((cells - wanted).square().mean().sqrt()) < 0.08 * float(wanted.square().mean().sqrt())
    for k in range(2):
        # The center of each blob lies where the feature is seen.
        part, _ = GridMap(RIG, grid)(ranges._replace(valid=torch.tensor([[k == 0, k == 1]])), pose)
        row, column = divmod(int(part.argmax()), 300)
        x, y = to_body(pose, *grid.center(torch.tensor(row), torch.tensor(column)))
        assert float(x) == pytest.approx(float(ranges.x[0, k]), abs=0.03)
        assert float(y) == pytest.approx(float(ranges.y[0, k]), abs=0.02)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_the_map_is_never_negative_and_only_grows(seed):
    ranges, pose = random_run(seed)
    mapper = GridMap(RIG, GRID)
    first, state = mapper(ranges, pose)
    first = first.clone()
    second, _ = mapper(ranges, pose, state)
    assert (first >= 0).all()
    torch.testing.assert_close(second, 2 * first)
    normal = mapper.normalise(second)
    assert float(normal.max()) == (1.0 if ranges.valid.any() else 0.0)


@pytest.mark.parametrize("certainty", ["beams", "log-odds"])
def test_an_old_state_stays_as_it_was(certainty):
    """Whoever keeps a state can go on from it, as often as wanted; nothing is changed behind anybody's back."""
    mapper = GridMap(RIG, GRID, certainty=certainty)
    first, later = random_run(3, 2), random_run(4, 2)
    _, kept = mapper(*first)
    before = kept.cells.clone()
    one, after = mapper(*later, kept)
    other, _ = mapper(*later, kept)
    assert torch.equal(kept.cells, before)
    assert torch.equal(one, other)
    assert not torch.equal(after.cells, before)
    # Tiles that were not touched are shared.
    tiles = [pair for rows in zip(kept.tiles.rows, after.tiles.rows, strict=True) for pair in zip(*rows, strict=True)]
    assert any(a is b for a, b in tiles)
    assert all(a is b or a.untyped_storage().data_ptr() != b.untyped_storage().data_ptr() for a, b in tiles)


@pytest.mark.parametrize("certainty", ["beams", "log-odds"])
def test_chunks_and_batches(certainty):
    ranges, pose = random_run(1, 2, 2)
    mapper = GridMap(RIG, GRID, certainty=certainty)
    whole, _ = mapper(ranges, pose)
    state = None
    for t in range(6):
        now = slice(t, t + 1)
        out, state = mapper(Ranges(*(p[..., now, :] for p in ranges)), Pose(*(p[..., now] for p in pose)), state)
    torch.testing.assert_close(out, whole, atol=1e-5, rtol=1e-5)
    alone, _ = mapper(Ranges(*(p[1, 0] for p in ranges)), Pose(*(p[1, 0] for p in pose)))
    torch.testing.assert_close(alone, whole[1, 0], atol=1e-5, rtol=1e-5)
    assert whole.shape == (2, 2, GRID.rows, GRID.columns)


def test_what_lies_outside_is_ignored():
    small = Grid(0.0, 1.0, -1.0, 1.0)
    cells, state = GridMap(RIG, small)(ranges_of([[[1.8, 0.0], [1.4, 0.9]]]), poses([0.0, 0.0, 0.0]))
    assert cells.sum() == 0
    assert state.cells.sum() > 0  # in the margin
    cells, _ = GridMap(RIG, small)(ranges_of([[[0.8, 0.0]]]), poses([0.0, 0.0, 0.0]))
    assert cells.sum() > 0


def test_two_views_sharpen_the_map():
    """The same point seen from two directions is more certain than either view alone."""
    point = torch.tensor([1.5, 0.5])
    here, there = poses([0.0, 0.0, 0.0]), poses([1.2, -0.9, math.pi / 2])
    mapper = GridMap(RIG, GRID)
    single, state = mapper(ranges_of(torch.stack(to_body(here, *point), -1).unsqueeze(0)), here)
    single = single.clone()
    both, _ = mapper(ranges_of(torch.stack(to_body(there, *point), -1).unsqueeze(0)), there, state)
    row, column = divmod(int(both.argmax()), GRID.columns)
    x, y = GRID.center(torch.tensor(row), torch.tensor(column))
    assert math.hypot(float(x) - 1.5, float(y) - 0.5) < 0.02
    assert both.max() > 1.5 * single.max()


def test_log_odds():
    mapper = GridMap(RIG, GRID, certainty="log-odds")
    look = ranges_of([[[1.5, 0.0]]]), poses([0.0, 0.0, 0.0])
    state = None
    for _ in range(10):
        cells, state = mapper(*look, state)
    probability = cells.sigmoid()
    at = lambda x, y: float(probability[round((y + 3) * 100), round((x + 1) * 100)])  # noqa: E731
    assert at(1.5, 0.0) > 0.6  # the feature
    assert at(0.8, 0.0) < 0.4  # the line of sight
    assert at(2.5, 0.0) == 0.5  # behind it nothing is known
    assert at(0.8, 0.5) == 0.5
    for _ in range(200):
        state = mapper.update(*look, state)
    assert float(state.cells.abs().max()) == mapper.odds.limit
    # It changes its mind: something is now seen through the place.
    further = ranges_of([[[2.1, 0.0]]]), look[1]
    for _ in range(200):
        cells, state = mapper(*further, state)
    probability = cells.sigmoid()
    assert at(1.5, 0.0) < 0.4


def test_bad_maps():
    with pytest.raises(InputError, match="left < right"):
        Grid(1.0, 0.0)
    with pytest.raises(InputError, match="too many"):
        Grid(-1e6, 1e6, -1e6, 1e6)
    with pytest.raises(InputError, match="reach"):
        GridMap(RIG, GRID, reach=0.0)
    with pytest.raises(InputError, match="certainty"):
        GridMap(RIG, GRID, certainty="odds")
    with pytest.raises(InputError, match="hit"):
        LogOdds(hit=-1.0)
    ranges, pose = random_run(0)
    for mapper in (GridMap(RIG, GRID), GridMap(RIG, GRID, certainty="log-odds"), ObservationList(0.1)):
        with pytest.raises(InputError, match="poses"):
            mapper(ranges, Pose(*(part[:3] for part in pose)))
    _, state = GridMap(RIG, GRID)(ranges, pose)
    with pytest.raises(InputError, match="do not fit"):
        GridMap(RIG, Grid())(ranges, pose, state)


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


@pytest.mark.parametrize("name", ["ranges.x", "ranges.y", "pose.x", "pose.y", "pose.heading"])
def test_numbers_of_half_precision_are_refused_by_name(name):
    ranges, pose = random_run(1)
    kind, part = name.split(".")
    spoiled = ranges if kind == "ranges" else pose
    spoiled = spoiled._replace(**{part: getattr(spoiled, part).half()})
    given = (spoiled, pose) if kind == "ranges" else (ranges, spoiled)
    with pytest.raises(InputError, match=f"{name} must be float32 or float64, got torch.float16"):
        GridMap(RIG, GRID)(*given)
