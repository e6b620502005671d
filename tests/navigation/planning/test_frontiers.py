"""Where exploring goes, on maps that are given: what is worth a way, what can be reached, and when it is given up."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ndtorch.navigation.controllers.goal import GoalControl, GoalParams
from ndtorch.navigation.controllers.goal.replanning import check_progress, visited_cells
from ndtorch.navigation.planning.costmap import LocalMap, clear_footprint, clearance
from ndtorch.navigation.planning.frontiers import cheapest_goal, frontier_costs, large_components, opening
from ndtorch.navigation.planning.planner import plan
from tests.navigation.controllers.goal.test_goal_control import DT, RIG, SMALL, floor, place
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


def test_half_a_metre_around_the_car_what_is_no_nearer_than_it_stands_is_let_out():
    price = np.full((40, 40), np.inf, np.float32)
    price[20, 22] = 3.0
    near = np.repeat(np.linspace(0.0, 0.39, 40, dtype=np.float32)[:, None], 40, 1)
    clear_footprint(price, near, (20, 20), 0.1, PARAMS)
    rows, columns = np.nonzero(np.isfinite(price))
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (15, 25, 15, 25)
    assert price[20, 22] == 3.0
    assert price[20, 21] == 1.0 + PARAMS.clearance_cost + PARAMS.obstacle_cost
    # Nearer than it stands, and in what is blocked, it does not get.
    clear_footprint(price := np.full((40, 40), np.inf, np.float32), near, (8, 39), 0.1, PARAMS)
    rows, columns = np.nonzero(np.isfinite(price))
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (3, 13, 34, 39)
    clear_footprint(price := np.full((40, 40), np.inf, np.float32), near, (2, 2), 0.1, PARAMS)
    rows, columns = np.nonzero(np.isfinite(price))
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (1, 7, 0, 7)


@pytest.mark.parametrize(("half", "free"), [(0.2, True), (1.0, False)])
def test_a_car_between_things_that_are_too_near_gets_out_where_that_is_not_far(half, free):
    visited = np.ones((SIDE, SIDE), bool)
    visited[square(-3.8, -3.0, 2, 3)] = False
    around = world((-2.4, -2.1, -half, half), (-1.9, -1.6, -half, half))
    made = explored(around, visited, (-2.0, 0.0, math.pi / 2))
    assert math.isfinite(made.cost) == free


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


@pytest.mark.parametrize(("side", "worth"), [(0.5, False), (0.6, True)])
def test_a_patch_never_seen_is_an_aim_from_its_least_area_on(side, worth):
    around, visited = world(), np.ones((SIDE, SIDE), bool)
    patch = square(0.0, side, 0.0, side)
    around.free[patch] = visited[patch] = False
    assert (side**2 > PARAMS.min_unknown_frontier_m2) == worth
    assert math.isfinite(explored(around, visited).cost) == worth


def test_what_was_never_seen_beside_the_way_comes_after_what_was_seen():
    around, visited = world(), np.ones((SIDE, SIDE), bool)
    around.free[square(-2.5, -1.0, 1.0, 2.5)] = False
    visited[square(-2.5, -1.0, 1.0, 2.5)] = False
    beside = explored(around, visited)
    assert beside.cost == pytest.approx(1.0 + PARAMS.unknown_frontier_cost_m, abs=0.4)
    visited[square(1.0, 2.0, -0.5, 0.5)] = False
    both = explored(around, visited)
    assert both.cost == pytest.approx(3.0, abs=0.3)


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


def test_the_end_of_the_cheapest_way_is_found():
    visited = np.ones((SIDE, SIDE), bool)
    visited[square(1.0, 2.0, -0.5, 0.5)] = False
    around = world()
    made = explored(around, visited)
    x, y = cheapest_goal(made.to_go, around, PARAMS.costmap_cells, (-2.0, 0.0))
    assert x == pytest.approx(1.0, abs=0.15)
    assert abs(y) < 0.15


@pytest.mark.parametrize("end", [(0, 0), (4, 6), (0, 6), (4, 0), (2, 3)])
@pytest.mark.parametrize("begin", [(2, 3), (0, 0), (4, 6), (-3, 9), (9, -3)])
def test_downhill_from_anywhere_to_the_only_end(end, begin):
    """Cells of .2 m from 1, -2 on; a place outside counts as the nearest cell."""
    around = LocalMap(np.zeros((10, 14), bool), np.zeros((10, 14), bool), 1.0, -2.0, 0.1)
    rows, columns = np.indices((5, 7))
    cost = (0.2 * np.hypot(rows - end[0], columns - end[1])).astype(np.float32)
    here = (1.0 + 0.2 * (begin[1] + 0.5), -2.0 + 0.2 * (begin[0] + 0.5))
    assert cheapest_goal(cost, around, 2, here) == pytest.approx((1.1 + 0.2 * end[1], -1.9 + 0.2 * end[0]))


def test_downhill_by_the_nearer_of_two_that_are_as_low_and_nowhere_from_where_nothing_leads():
    around = LocalMap(np.zeros((6, 6), bool), np.zeros((6, 6), bool), 0.0, 0.0, 0.1)
    cost = np.array([[3, 9, 1.9], [9, 2, 9], [9, 1.9, 9]], np.float32)
    # From the middle to the one below it, not to the one in the corner.
    assert cheapest_goal(cost, around, 2, (0.3, 0.3)) == pytest.approx((0.3, 0.5))
    cost[0, 2] = 1.7
    assert cheapest_goal(cost, around, 2, (0.3, 0.3)) == pytest.approx((0.5, 0.1))
    cost[1, 1] = np.inf
    assert cheapest_goal(cost, around, 2, (0.3, 0.3)) == pytest.approx((0.3, 0.3))


@pytest.mark.parametrize("turned", range(4))
def test_no_way_leads_over_a_cell_that_it_cannot_pass(turned):
    cost = np.full((5, 5), np.inf, np.float32)
    cost[2, 2], cost[2, 0] = 2, 0
    around = LocalMap(np.zeros((10, 10), bool), np.zeros((10, 10), bool), 0.0, 0.0, 0.1)
    assert cheapest_goal(np.rot90(cost, turned), around, 2, (0.5, 0.5)) == pytest.approx((0.5, 0.5))


def test_where_a_way_may_end():
    """Floor that was seen and not passed costs nothing, what was never seen beside it a price."""
    wall = world((1.0, 1.5, -4, 4))
    visited = np.zeros((SIDE, SIDE), bool)
    visited[square(-4.0, -1.0, -4, 4)] = True
    wall.free[square(-3.0, -2.0, -1.0, 1.0)] = False
    visited[square(-3.0, -2.0, -1.0, 1.0)] = False
    # Beyond the wall nothing was seen, and nothing borders on floor.
    wall.free[square(1.5, 4.0, -4.0, 4.0)] = False
    seed = frontier_costs(wall, visited, clearance(wall.blocked, CELL), PARAMS)
    assert set(np.unique(seed)) == {0.0, PARAMS.unknown_frontier_cost_m, np.inf}
    x = -4.0 + 2 * CELL * (np.argwhere(seed == 0)[:, 1] + 0.5)
    y = -4.0 + 2 * CELL * (np.argwhere(seed == 0)[:, 0] + 0.5)
    assert (x.min(), x.max()) == pytest.approx((-0.95, 1.0 - PARAMS.min_clearance_m), abs=0.06)
    assert (y.min(), y.max()) == pytest.approx((-3.95, 3.95), abs=0.06)
    # The border of the unseen square, two cells wide at most, and not its inside.
    unseen = -4.0 + 2 * CELL * (np.argwhere(seed == PARAMS.unknown_frontier_cost_m) + 0.5)
    assert np.abs(unseen[:, 1] + 2.5).max() < 0.5
    assert np.abs(unseen[:, 0]).max() < 1.0
    deep = np.minimum(0.5 - np.abs(unseen[:, 1] + 2.5), 1.0 - np.abs(unseen[:, 0]))
    assert deep.max() < 3 * CELL


def test_what_was_tried_in_vain_counts_as_passed():
    params = GoalParams(explore=True, reactive=SMALL)
    control = GoalControl(RIG, DT, params)
    state = control.start(floor(), place(*AROUND))
    visited = np.ones((SIDE, SIDE), bool)
    visited[square(1.0, 2.0, -0.5, 0.5)] = False
    around = world()
    made = explored(around, visited)
    state = check_progress(state, made, around, AROUND, params)._replace(cost=made.cost)
    assert float(state.best_cost) == pytest.approx(made.cost)
    for tried in (0.0, params.no_progress_s + made.cost / params.unknown_speed_m_per_s - 0.1):
        state = check_progress(state._replace(no_progress_s=tried), made, around, AROUND, params)
        assert not state.visited.evidence.any()
    nearer = check_progress(state, made._replace(cost=made.cost - 0.2), around, AROUND, params)
    assert float(nearer.no_progress_s) == 0
    assert check_progress(state, made._replace(cost=math.inf), around, AROUND, params) is state
    # Aims that change to and fro are no success, and a far one is given the time that it takes.
    tried = params.no_progress_s + made.cost / params.unknown_speed_m_per_s + 0.1
    dear = made._replace(cost=made.cost + 2.0)
    far = check_progress(state._replace(no_progress_s=tried), dear, around, AROUND, params)
    assert not far.visited.evidence.any()
    assert float(far.no_progress_s) == pytest.approx(float(tried))
    assert float(far.best_cost) == pytest.approx(made.cost)
    state = check_progress(state._replace(no_progress_s=tried), made, around, AROUND, params)
    cells = visited_cells(state.visited.evidence, 0.0, 0.0, SMALL.grid, params.visited_grid)
    row, column = np.argwhere(cells).mean(0)
    left = (-SMALL.grid.size // 2 + 1) * CELL
    assert left + (column + 0.5) * CELL == pytest.approx(1.0, abs=0.15)
    assert left + (row + 0.5) * CELL == pytest.approx(0.0, abs=0.15)
    assert cells.sum() * CELL**2 == pytest.approx(math.pi * params.blacklist_radius_m**2, rel=0.25)
    assert math.isinf(float(state.best_cost))


def test_exploring_remembers_longer_than_going_to_a_place():
    patch = GoalControl(RIG, DT, GoalParams(explore=True)).params.reactive.grid
    assert patch.lifetime == GoalParams().exploration_memory_s > GoalParams().reactive.grid.lifetime
    going = GoalControl(RIG, DT, GoalParams(goal=(1.0, 0.0))).params.reactive.grid
    assert going == GoalParams().reactive.grid
    assert replace(patch, lifetime=going.lifetime) == going


def test_small_and_narrow_parts_are_left_out():
    cells = np.zeros((20, 20), bool)
    cells[2:8, 2:8] = cells[12:15, 2:5] = cells[5, 8:18] = True
    wide = opening(cells, 3)
    assert not wide[5, 9:].any()
    assert wide.sum() == 36 + 9
    assert large_components(wide, 10).sum() == 36
    assert large_components(wide, 40).sum() == 0
