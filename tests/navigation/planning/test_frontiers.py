"""Where exploring goes, on maps that are given: what is worth a way, what can be reached, and when it is given up."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ndtorch.navigation.planning.costmap import LocalMap, clearance
from ndtorch.navigation.planning.frontiers import cheapest_goal, frontier_costs
from ndtorch.navigation.planning.planner import plan
from tests.navigation.planning.test_planner import CELL, PARAMS, SIDE, world

AROUND = (-2.0, 0.0, 0.0)


def square(left, right, bottom, top):
    a, b, c, d = (round((v + 4) / CELL) for v in (left, right, bottom, top))
    return np.s_[c:d, a:b]


def explored(around, visited, pose=AROUND):
    clear = clearance(around.blocked, CELL)
    seed = frontier_costs(around, visited, clear, PARAMS)
    return plan(around, clear, seed, pose, 0.0, 1.0, PARAMS, through=False)


def test_exploring_ends_where_nothing_is_left_and_goes_through_no_wall():
    visited = np.zeros((SIDE, SIDE), bool)
    assert math.isfinite(explored(world(), visited).cost)
    assert math.isinf(explored(world(), ~visited).cost)
    wall = (-1.0, -0.8, -4, 4)
    visited[:, : round(3.2 / CELL)] = True
    made = explored(world(wall), visited)
    assert math.isinf(made.cost)
    assert len(made.path) == 1
    # Of a place that it was told it goes as near as it can.
    around = world(wall)
    to = np.full((SIDE // 2, SIDE // 2), np.inf, np.float32)
    to[40, 60] = 0
    assert math.isfinite(plan(around, clearance(around.blocked, CELL), to, AROUND, 0.0, 1.0, PARAMS).cost)


def test_a_gap_that_admits_the_car_is_a_way_to_what_is_left():
    visited = np.zeros((SIDE, SIDE), bool)
    visited[:, : round(3.2 / CELL)] = True
    gap = world((-1.0, -0.8, -4, 0.2), (-1.0, -0.8, 0.8, 4))
    assert 1 < explored(gap, visited).cost < 6


def test_a_car_that_stands_near_a_wall_may_leave_but_not_through_it():
    wall = (-1.0, -0.9, -4, 4)
    visited = np.ones((SIDE, SIDE), bool)
    visited[square(-3.8, -3.0, -1, 1)] = False
    beside = (-1.15, 0.0, math.pi / 2)
    assert math.isfinite(explored(world(wall), visited, beside).cost)
    other = np.ones((SIDE, SIDE), bool)
    other[square(1.0, 3.0, -1, 1)] = False
    assert math.isinf(explored(world(wall), other, beside).cost)


def test_a_gap_that_seems_a_little_too_narrow_is_dear_and_one_that_is_much_too_narrow_is_none():
    visited = np.zeros((SIDE, SIDE), bool)
    visited[:, : round(3.2 / CELL)] = True
    costs = [explored(world((-1.0, -0.9, -4, 0.2), (-1.0, -0.9, 0.2 + w, 4)), visited).cost for w in (0.9, 0.4, 0.2)]
    assert costs[0] + 4 < costs[1] < math.inf == costs[2]


def test_a_scrap_in_a_corner_is_no_aim():
    visited = np.ones((SIDE, SIDE), bool)
    scrap = square(3.0, 3.25, 3.0, 3.25)
    visited[scrap] = False
    assert math.isinf(explored(world(), visited).cost)
    visited[square(2.8, 3.25, 2.8, 3.25)] = False
    assert math.isfinite(explored(world(), visited).cost)


@pytest.mark.parametrize("gap", [0.5, 0.9])
def test_it_goes_over_nothing_unseen_where_the_cameras_see_no_floor(gap):
    """Ahead of the car the unseen begins, or a wall that is not known: it may come near, and no nearer."""
    around, visited = world(), np.ones((SIDE, SIDE), bool)
    unseen = square(-2.0 + gap, 4.0, -4.0, 4.0)
    around.free[unseen], visited[unseen] = False, False
    clear = clearance(around.blocked, CELL)
    seed = frontier_costs(around, visited, clear, PARAMS)
    bold = plan(around, clear, seed, AROUND, 0.0, 1.0, replace(PARAMS, blind_distance_m=0.1), through=False)
    careful = plan(around, clear, seed, AROUND, 0.0, 1.0, PARAMS, through=False)
    lead = PARAMS.footprint_centers_m[-1] + PARAMS.footprint_radius_m
    near = [math.dist(place[:2], AROUND[:2]) <= PARAMS.blind_distance_m + 0.01 for place in careful.path]
    ahead = careful.path[:, 0] + lead * np.cos(careful.path[:, 2])
    assert (ahead[near & (careful.path[:, 4] > 0)] <= -2.0 + gap + 2 * CELL).all()
    if gap < lead + PARAMS.blind_distance_m:
        assert (bold.path[:3, 0] + lead).max() > -2.0 + gap + 2 * CELL
    else:
        assert ahead.max() > -2.0 + gap


@pytest.mark.parametrize("end", [(0, 0), (4, 6), (0, 6), (4, 0), (2, 3)])
@pytest.mark.parametrize("begin", [(2, 3), (0, 0), (4, 6), (-3, 9), (9, -3)])
def test_downhill_from_anywhere_to_the_only_end(end, begin):
    """Cells of .2 m from 1, -2 on; a place outside counts as the nearest cell."""
    around = LocalMap(np.zeros((10, 14), bool), np.zeros((10, 14), bool), 1.0, -2.0, 0.1)
    rows, columns = np.indices((5, 7))
    cost = (0.2 * np.hypot(rows - end[0], columns - end[1])).astype(np.float32)
    here = (1.0 + 0.2 * (begin[1] + 0.5), -2.0 + 0.2 * (begin[0] + 0.5))
    assert cheapest_goal(cost, around, 2, here) == pytest.approx((1.1 + 0.2 * end[1], -1.9 + 0.2 * end[0]))
