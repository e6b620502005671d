"""The observation list, and how far an arc is free of what it holds."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.navigation import ObservationList, Pose
from ndtorch.navigation.mapping.observations import Observations, arc_coordinates, free_length
from tests.navigation.mapping.test_grid_map import poses, ranges_of


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
