"""Planning on a map that is given: paths fit the outline, keep to the turning circle, and lead to the goal."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from ndtorch.navigation import Body
from ndtorch.navigation.planning import (
    HORIZON_M,
    MAX_REVERSE_SPEED,
    MIN_SPEED,
    LocalMap,
    PlannerParams,
    clearance,
    goal_costs,
    plan,
    pure_pursuit,
    speed_profile,
    tracking_speed,
    unvisited_costs,
)

CELL, SIDE = 0.05, 160
BODY = Body()
PARAMS = PlannerParams()
HERE = (-2.0, 0.0, 0.0)


def box(left, right, bottom, top):
    """The cells of a box of the map."""
    a, b, c, d = (round((v + 4) / CELL) for v in (left, right, bottom, top))
    return np.s_[c:d, a:b]


def world(*boxes):
    """8 x 8 m around the origin with blocked boxes (left, right, bottom, top); the rest is free."""
    blocked = np.zeros((SIDE, SIDE), bool)
    for sides in boxes:
        blocked[box(*sides)] = True
    return LocalMap(blocked, ~blocked, -4.0, -4.0, CELL)


def planned(around, goal, pose=HERE, params=PARAMS):
    return plan(params, around, goal_costs(around, goal), pose)


def explored(around, visited, pose=HERE):
    return plan(PARAMS, around, unvisited_costs(PARAMS, around, visited), pose, exploring=True)


def outline(path, body):
    """Corners and middles of the sides of the body along a path, `[n, 6, 2]`."""
    x, y, heading = path[:, None, :3].T
    along = np.array([-1, 0, 1, -1, 0, 1])[:, None] * body.length_m / 2
    aside = np.array([-1, -1, -1, 1, 1, 1])[:, None] * body.width_m / 2
    cos, sin = np.cos(heading), np.sin(heading)
    return np.stack((x + along * cos - aside * sin, y + along * sin + aside * cos), -1)


def test_the_discs_cover_the_body():
    x, y = np.meshgrid(np.linspace(-0.25, 0.25, 41), np.linspace(-0.18, 0.18, 31))
    away = np.hypot(x[..., None] - PARAMS.centers, y[..., None]).min(-1)
    assert away.max() == pytest.approx(PARAMS.radius_m, abs=1e-3)


def test_in_the_open_the_path_is_straight():
    made = planned(world(), (2.0, 0.0))
    assert made.cost == pytest.approx(4.0, abs=0.15)
    assert abs(made.path[:, 1]).max() < 0.02
    assert made.path[-1, 0] >= -2.0 + HORIZON_M - 0.01
    assert made.path[:, 5] == pytest.approx(PARAMS.speed_m_per_s)
    beyond = planned(world(), (6.0, 0.0))
    assert beyond.path[-1, 0] == pytest.approx(made.path[-1, 0])


@pytest.mark.parametrize("side", [1, -1])
def test_a_path_leads_through_a_gap_slowly_and_no_part_of_the_body_through_the_wall(side):
    bottom, top = sorted((side * 0.4, side * 1.1))
    around = world((-0.5, -0.35, -4, bottom), (-0.5, -0.35, top, 4))
    made = planned(around, (2.0, 0.0))
    assert made.path[-1, 0] > -0.3
    assert abs(made.path[:, 3]).max() <= 0.9 / BODY.min_turn_radius_m + 1e-6
    assert not around.blocked[around.cells_of(*outline(made.path, BODY).reshape(-1, 2).T)].any()
    in_gap = abs(made.path[:, 0] + 0.42) < 0.2
    assert made.path[in_gap, 5].max() < 0.45


def test_a_gap_narrower_than_the_body_is_no_path():
    around = world((-0.5, -0.35, -4, -0.15), (-0.5, -0.35, 0.15, 4))
    assert planned(around, (2.0, 0.0)).path[:, 0].max() < -0.6


@pytest.mark.parametrize("radius", [0.3, 0.45, 0.6, 0.9])
def test_a_car_backs_on_arcs_of_any_turning_radius_where_floor_was_seen(radius):
    """It stands before a wall, the goal is beside and behind it: it has to turn while it backs."""
    params = PlannerParams(body=Body(min_turn_radius_m=radius))
    around = world((-1.55, -1.4, -4, 4))
    made = planned(around, (-3.2, 1.6), params=params)
    backward = made.path[made.path[:, 4] < 0]
    assert len(backward)
    assert abs(backward[:, 3]).max() == pytest.approx(params.max_curvature_per_m)
    assert 1 / params.max_curvature_per_m >= radius
    unseen = around._replace(free=np.zeros_like(around.free))
    assert (planned(unseen, (-3.2, 1.6), params=params).path[:, 4] == 1).all()


def test_exploring_ends_where_nothing_is_left_and_goes_through_no_wall():
    visited = np.zeros((SIDE, SIDE), bool)
    assert math.isfinite(explored(world(), visited).cost)
    assert math.isinf(explored(world(), ~visited).cost)
    visited[box(-4, -0.8, -4, 4)] = True
    wall = world((-1.0, -0.8, -4, 4))
    made = explored(wall, visited)
    assert (math.isinf(made.cost), len(made.path)) == (True, 1)
    # To a goal it goes as near as it can.
    assert 40 * 0.2 < planned(wall, (1.0, 0.0)).cost < math.inf
    gap = world((-1.0, -0.8, -4, 0.2), (-1.0, -0.8, 0.8, 4))
    assert 1 < explored(gap, visited).cost < 6


def test_exploring_leads_to_the_nearest_unvisited_floor():
    visited = np.ones((SIDE, SIDE), bool)
    visited[box(-1.0, 0.0, 2.0, 3.0)] = visited[box(3.0, 3.1, 3.0, 3.1)] = False
    made = explored(world(), visited)
    assert made.cost == pytest.approx(math.hypot(1.0, 2.0), abs=0.25)
    assert made.path[-1, 1] > 0.8


PATH = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 1.0, 0.5],
        [0.2, 0.0, 0.1, 0.5, 1.0, 0.5],
        [0.4, 0.03, 0.3, 1.0, 1.0, 0.4],
        [0.58, 0.12, 0.6, 1.5, 1.0, 0.0],
        [0.42, 0.02, 0.4, 1.0, -1.0, 0.3],
        [0.2, -0.04, 0.2, 1.0, -1.0, 0.3],
    ],
    np.float32,
)
WIDE = 99.0
"""A largest curvature that limits nothing."""


def arc_to(pose, point):
    """Curvature of the circle that touches the heading and goes through a point: sine law, 2 sin(angle) / distance."""
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    return 2 * math.sin(math.atan2(dy, dx) - pose[2]) / math.hypot(dx, dy)


@pytest.mark.parametrize("pose", [(0.01, 0.02, 0.1), (0.1, -0.05, -0.3), (0.3, 0.1, 0.2), (0.42, 0.0, 0.5)])
def test_pure_pursuit_aims_at_the_point_so_far_along_the_path_and_straight_on_beyond_its_end(pose):
    points = [pose[:2], *(tuple(p) for p in PATH[1:4, :2].tolist() if p[0] > pose[0] + 0.02)]
    for ahead in (0.1, 0.3, 0.45, 0.8):
        aim, left = pure_pursuit(PATH, 0, pose, ahead, WIDE), ahead
        for a, b in pairwise(points):
            if left <= math.dist(a, b):
                ratio = left / math.dist(a, b)
                target = a[0] + ratio * (b[0] - a[0]), a[1] + ratio * (b[1] - a[1])
                break
            left -= math.dist(a, b)
        else:
            target = points[-1][0] + left * math.cos(0.6), points[-1][1] + left * math.sin(0.6)
        assert aim.direction == 1.0
        assert aim.curvature == pytest.approx(arc_to(pose, target), abs=1e-4)
        assert abs(pure_pursuit(PATH, 0, pose, ahead, 0.1).curvature) <= 0.1


def test_beyond_the_end_of_a_stretch_the_next_one_begins_and_beyond_the_last_none():
    aim = pure_pursuit(PATH, 0, (0.6, 0.13, 0.6), 0.3, WIDE)
    assert (aim.direction, aim.at) == (-1.0, 3)
    done = pure_pursuit(PATH, 3, (0.1, -0.06, 0.2), 0.3, WIDE)
    assert (done.direction, done.at) == (0.0, 5)


def test_speeds_are_those_that_can_be_braked_to_the_next_one():
    """v^2 = v'^2 + 2 a s from point to point, 0 where the direction changes, and slow into unknown cells."""
    around, params = world(), PlannerParams(deceleration_m_per_s2=0.1)
    clear = clearance(around.blocked, CELL)
    path = np.array([[v, 0.0, 0.0, 0.0, 1.0] for v in (0.0, 0.2, 0.5, 0.6, 0.5)], np.float32)
    path[4, 4] = -1.0
    stop = speed_profile(params, path, around, clear)
    braked = [math.sqrt(0.2 * s) for s in (0.6, 0.4, 0.1)]
    assert stop == pytest.approx([*braked, 0.0, MAX_REVERSE_SPEED], abs=1e-5)
    around.free[box(1.2, 4.0, -4.0, 4.0)] = False
    lead = PARAMS.centers[-1] + PARAMS.radius_m
    path = np.array([[v - lead, 0.0, 0.0, 0.0, 1.0] for v in (0.6, 0.9, 1.3, 1.5)], np.float32)
    slow = speed_profile(params, path, around, clear)
    before = math.sqrt(0.3**2 + 0.2 * 0.4)
    assert slow == pytest.approx([math.sqrt(before**2 + 0.2 * 0.3), before, 0.3, 0.3], abs=1e-5)
    there = tracking_speed(np.column_stack((path, slow)), 1, (1.0 - lead, 0.0, 0.0), 0.1)
    assert there == pytest.approx(math.sqrt(0.3**2 + 0.2 * 0.3), abs=1e-5)
    assert tracking_speed(PATH, 2, (0.58, 0.12, 0.6), 0.1) == MIN_SPEED
