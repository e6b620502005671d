"""Planning on a map that is given: ways fit the outline, keep to the turning circle, and lead to the goal."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from ndtorch.navigation.planning.costmap import LocalMap, clearance, with_backs
from ndtorch.navigation.planning.frontiers import cheapest_goal, frontier_costs
from ndtorch.navigation.planning.params import PlannerParams
from ndtorch.navigation.planning.path_tracking import SpeedLimits, pure_pursuit, seen_length, seen_points, speed_profile
from ndtorch.navigation.planning.planner import Plan, goal_costs, plan

CELL, SIDE = 0.05, 160
PARAMS = PlannerParams()


def world(*boxes, free=True):
    """8 x 8 m around the origin with blocked boxes (left, right, bottom, top)."""
    blocked = np.zeros((SIDE, SIDE), bool)
    for left, right, bottom, top in boxes:
        a, b, c, d = (round((v + 4) / CELL) for v in (left, right, bottom, top))
        blocked[c:d, a:b] = True
    return LocalMap(blocked, ~blocked & free, -4.0, -4.0, CELL)


def planned(around, goal, pose=(-2.0, 0.0, 0.0), direction=1.0):
    clear = clearance(around.blocked, CELL)
    return plan(around, clear, goal_costs(around, goal, PARAMS), pose, 0.0, direction, PARAMS)


def test_in_the_open_it_goes_straight():
    made = planned(world(), (2.0, 0.0))
    assert made.cost == pytest.approx(4.0, abs=0.15)
    assert abs(made.path[:, 1]).max() < 0.02
    assert made.path[-1, 0] >= -2.0 + PARAMS.horizon_m - 0.01


@pytest.mark.parametrize("side", [1, -1])
def test_it_goes_through_the_gap_and_no_part_of_the_body_is_in_the_wall(side):
    bottom, top = sorted((side * 0.4, side * 1.1))
    around = world((-0.5, -0.35, -4, bottom), (-0.5, -0.35, top, 4))
    made = planned(around, (2.0, 0.0))
    x, y, heading, curvature, _ = made.path.T
    assert made.path[-1, 0] > -0.3
    assert abs(curvature).max() <= 1 / PARAMS.min_turn_radius_m + 1e-6
    for along in (-0.25, 0.0, 0.25):
        for aside in (-0.18, 0.18):
            px, py = x + along * np.cos(heading) - aside * np.sin(heading), y + along * np.sin(heading)
            py += aside * np.cos(heading)
            cells = [around.blocked[around.cell_of(*place)] for place in zip(px, py, strict=True)]
            assert not any(cells)


def test_a_gap_narrower_than_the_body_is_no_way():
    around = world((-0.5, -0.35, -4, -0.15), (-0.5, -0.35, 0.15, 4))
    assert planned(around, (2.0, 0.0)).path[:, 0].max() < -0.6


def test_out_of_a_dead_end_it_backs_where_floor_was_seen_and_not_into_what_was_not():
    walls = ((-1.55, -1.4, -0.5, 0.5), (-2.4, -1.4, 0.35, 0.5), (-2.4, -1.4, -0.5, -0.35))
    seen = planned(world(*walls), (2.0, 0.0))
    assert seen.path[1, 4] == -1
    around = world(*walls)
    unseen = around._replace(free=np.zeros_like(around.free))
    assert (planned(unseen, (2.0, 0.0)).path[:, 4] == 1).all()


def covers_the_unseen(made, around):
    """How many places of the next metre have the front of the body over cells that were not seen free."""
    count = 0
    for x, y, heading, _, direction in made.path[1:6]:
        across = 0.15 * np.array([-np.sin(heading), np.cos(heading)])
        front = np.array([x, y]) + 0.2 * direction * np.array([np.cos(heading), np.sin(heading)])
        count += any(not around.free[around.cell_of(*(front + side * across))] for side in (-1, 0, 1))
    return count


def test_it_does_not_turn_round_a_corner_into_what_it_has_not_seen():
    around = world()
    a, b, c, d = (round((v + 4) / CELL) for v in (-1.5, -0.6, -1.5, -0.2))
    around.free[c:d, a:b] = False
    clear, seed = clearance(around.blocked, CELL), goal_costs(around, (-0.9, -3.0), PARAMS)
    bold = plan(around, clear, seed, (-2.0, 0.0, 0.0), 0.0, 1.0, replace(PARAMS, unseen_cost=0.0))
    careful = plan(around, clear, seed, (-2.0, 0.0, 0.0), 0.0, 1.0, PARAMS)
    assert covers_the_unseen(bold, around) > covers_the_unseen(careful, around) == 0


def test_clearance_is_the_distance_to_what_is_blocked():
    around = world((0.0, 0.05, 0.0, 0.05))
    clear = clearance(around.blocked, CELL)
    row, column = around.cell_of(0.01, 0.01)
    assert clear[row, column] == 0
    assert clear[row, column + 10] == pytest.approx(10 * CELL)
    assert clear[row + 6, column - 8] == pytest.approx(10 * CELL, rel=0.03)
    assert (clearance(np.zeros((3, 4), bool), CELL) == 99.0).all()


def test_unknown_cells_near_an_obstacle_count_as_blocked_and_free_ones_do_not():
    rng = np.random.default_rng(3)
    blocked, free = rng.random((40, 40)) < 0.02, rng.random((40, 40)) < 0.5
    around = LocalMap(blocked, ~blocked & free, 0.0, 0.0, CELL)
    row, column = np.nonzero(blocked)
    down, across = np.indices(blocked.shape)
    away = CELL * np.hypot(down[..., None] - row, across[..., None] - column).min(-1)
    found = with_backs(around, 0.15)
    assert not (found & around.free).any()
    assert found[~around.free & (away < 0.14)].all()
    assert not found[away > 0.16].any()


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


WAY = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 1.0],
        [0.2, 0.0, 0.1, 0.5, 1.0],
        [0.4, 0.03, 0.3, 1.0, 1.0],
        [0.58, 0.12, 0.6, 1.5, 1.0],
        [0.42, 0.02, 0.4, 1.0, -1.0],
        [0.2, -0.04, 0.2, 1.0, -1.0],
    ],
    np.float32,
)
WIDE = 99.0
"""A largest curvature that limits nothing."""


def along(places: list[tuple[float, float]], length: float, heading: float, direction: float) -> tuple[float, float]:
    """The place so far along a broken line, and straight on beyond its end."""
    for (x, y), (to_x, to_y) in itertools.pairwise(places):
        piece = math.hypot(to_x - x, to_y - y)
        if length <= piece:
            return x + length / piece * (to_x - x), y + length / piece * (to_y - y)
        length -= piece
    x, y = places[-1]
    return x + length * direction * math.cos(heading), y + length * direction * math.sin(heading)


def arc_to(pose: tuple[float, float, float], place: tuple[float, float]) -> float:
    """Curvature of the circle that touches the heading and goes through a place: sine law, 2 sin(angle) / distance."""
    dx, dy = place[0] - pose[0], place[1] - pose[1]
    return 2 * math.sin(math.atan2(dy, dx) - pose[2]) / math.hypot(dx, dy)


@pytest.mark.parametrize("ahead", [0.1, 0.3, 0.45, 0.8])
@pytest.mark.parametrize("pose", [(0.01, 0.02, 0.1), (0.1, -0.05, -0.3), (0.3, 0.1, 0.2), (0.42, 0.0, 0.5)])
def test_it_aims_at_the_place_so_far_ahead_along_the_way(pose: tuple[float, float, float], ahead: float) -> None:
    aim = pure_pursuit(WAY, 0, pose, ahead, WIDE)
    left = [(float(x), float(y)) for x, y in WAY[aim.at + 1 : 4, :2]]
    aimed = along([pose[:2], *left], ahead, float(WAY[3, 2]), 1.0)
    assert aim.direction == 1.0
    assert aim.curvature == pytest.approx(arc_to(pose, aimed), abs=1e-4)
    lengths = [math.dist(a, b) for a, b in zip([pose[:2], *left], left, strict=False)]
    assert aim.left == pytest.approx(sum(lengths), abs=1e-6)


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize(("before", "reached"), [(0.021, 0), (0.019, 1), (-0.1, 1)])
def test_a_place_is_reached_2_cm_before_the_line_across_the_way(before: float, reached: int, direction: float) -> None:
    """The line is at right angles to the heading there, wherever aside the car is."""
    turned = 0.5
    cos, sin = math.cos(turned), math.sin(turned)
    way = np.array([[direction * 0.2 * n * cos, direction * 0.2 * n * sin, turned, 0, direction] for n in range(4)])
    for aside in (0.3, -0.3):
        x = direction * (0.2 - before)
        pose = (x * cos - aside * sin, x * sin + aside * cos, turned)
        assert pure_pursuit(way, 0, pose, 0.3, WIDE).at == reached


def test_beyond_the_end_of_a_stretch_the_next_one_begins_and_beyond_the_last_none() -> None:
    aim = pure_pursuit(WAY, 0, (0.6, 0.13, 0.6), 0.3, WIDE)
    assert (aim.direction, aim.at) == (-1.0, 3)
    assert pure_pursuit(WAY, 0, (0.1, -0.06, 0.2), 0.3, WIDE).direction == 1.0
    done = pure_pursuit(WAY, 3, (0.1, -0.06, 0.2), 0.3, WIDE)
    assert (done.direction, done.at, done.left) == (0.0, 5, 0.0)


LIMITS = SpeedLimits(0.5, 0.35, 0.2, 1.5)


def test_the_speed_before_what_is_slow_is_what_can_be_braked_from():
    """v^2 = v'^2 + 2 a s from place to place, and standing where the direction changes."""
    limits, blocked = LIMITS._replace(deceleration=0.1), np.zeros((60, 60), bool)
    around = LocalMap(blocked, ~blocked, -1.0, -1.0, 0.05)
    x = [0.0, 0.2, 0.5, 0.6, 0.7]
    way = np.array([[v, 0.0, 0.0, 0.0, 1.0] for v in x], np.float32)
    seen = np.zeros((60, 60), np.float32)
    way[3:, 4] = -1.0
    speeds = speed_profile(Plan(way, 1.0, seen + 9, seen, seen), around, limits, PlannerParams())
    back = limits.reverse
    begun = [math.sqrt(0.2 * 0.5), math.sqrt(0.2 * 0.3), math.sqrt(back**2 + 0.2 * 0.1), back, back]
    assert speeds.tolist() == pytest.approx(begun, abs=1e-5)


def test_a_path_is_seen_up_to_where_the_leading_disc_covers_unknown_cells():
    blocked = np.zeros((60, 60), bool)
    around = LocalMap(blocked, ~blocked, -1.0, -1.0, 0.05)
    way = np.array([[v, 0.0, 0.0, 0.0, 1.0] for v in (0.0, 0.2, 0.5, 0.6, 0.7)], np.float32)
    seen = np.zeros((60, 60), np.float32)
    unseen = seen.copy()
    unseen[:, round((0.65 + 0.2 + 1) / 0.05) :] = 1  # where a disc .1875 m ahead of the last place covers unknown cells
    assert seen_points(Plan(way, 1.0, seen + 9, seen, seen), around, PlannerParams()) == 5
    assert seen_points(Plan(way, 1.0, seen + 9, unseen, seen), around, PlannerParams()) == 4
    assert seen_length(way, 0, 5, (0.1, 0.0, 0.0)) == math.inf
    assert seen_length(way, 0, 4, (0.1, 0.0, 0.0)) == pytest.approx(0.5)
    assert seen_length(way, 2, 2, (0.5, 0.0, 0.0)) == 0
