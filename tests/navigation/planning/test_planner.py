"""Planning on a map that is given: ways fit the outline, keep to the turning circle, and lead to the goal."""

from dataclasses import replace

import numpy as np
import pytest

from ndtorch.navigation.planning.costmap import LocalMap, clearance, with_backs
from ndtorch.navigation.planning.params import PlannerParams
from ndtorch.navigation.planning.planner import goal_costs, plan

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
