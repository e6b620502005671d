"""The goal controller: what it is asked to do, and that its state is all it has."""

from __future__ import annotations

import copy
import math
from dataclasses import replace

import numpy as np
import pytest

from ndtorch.navigation import ARRIVED, CRUISE, Body, Command, NavigatorOptions, Pose, StereoRig
from ndtorch.navigation.controllers.goal import GoalControl, GoalParams
from ndtorch.navigation.controllers.goal.params import reactive_params
from ndtorch.navigation.controllers.goal.replanning import local_map, replan, visited_cells
from ndtorch.navigation.controllers.goal.tasks import (
    DONE,
    EXPLORE,
    GOAL,
    HOME,
    GoalState,
    is_fruitless,
    next_task,
    task_goal,
)
from ndtorch.navigation.controllers.ranging.control import BLOCKED
from ndtorch.navigation.local_grid._kernels import LocalGrid
from ndtorch.navigation.local_grid.grid import LocalGridParams, cells_at, empty_grid
from ndtorch.navigation.odometry import arc
from ndtorch.navigation.stereo.ranging import Ranges

RIG, DT = StereoRig(forward=0.15), 1 / 30
SMALL = replace(reactive_params(), grid=LocalGridParams(cell_m=0.05, size_cells=128))


def nothing():
    blank = np.zeros(4, np.float32)
    return Ranges(blank, blank, blank, blank, blank, blank > 0)


def floor(moves=True):
    """What open floor gives while the car moves at a steady speed, roughly; nothing while it stands."""
    return np.full((2, 14, 8), 0.5 if moves else 0.0, np.float32)


def drive(control, steps, pose, state=None):
    """Through open floor: the commands are obeyed at once."""
    command = Command(0.0, 0.0)
    state = control.start(floor(), pose) if state is None else state
    for _ in range(steps):
        command, state = control.step(floor(moves=command.speed != 0), nothing(), pose, command, state)
        pose = arc(pose, *command, DT)
    return pose, state, command


def place(x, y, heading):
    return Pose(x, y, heading)


def test_it_goes_to_the_place_and_back_and_stands():
    control = GoalControl(RIG, DT, GoalParams(goal=(1.5, 0.5), return_home=True, reactive=SMALL))
    state, pose, nearest = None, place(0.0, 0.0, 0.0), 9.0
    for _ in range(60):
        pose, state, command = drive(control, 10, pose, state)
        nearest = min(nearest, math.hypot(pose.x - 1.5, pose.y - 0.5))
        if int(control.mode(state)) == ARRIVED:
            break
    assert nearest < 0.5
    assert math.hypot(pose.x, pose.y) < 0.35
    assert float(command.speed) == 0


@pytest.mark.parametrize("goal", [(-1.5, 0.2), (-0.3, -1.5)])
def test_a_differential_drive_turns_on_the_spot_to_a_goal_behind_it(goal):
    """It drives ahead alone, and little more than the distance."""
    body = Body(min_turn_radius_m=0.0)
    control = GoalControl(RIG, DT, GoalParams(goal=goal, reactive=replace(SMALL, body=body)))
    pose, state, command = drive(control, 20, place(0.0, 0.0, 0.0))
    left, driven = math.dist(pose[:2], goal), 0.0
    for _ in range(600):
        pose, state, command = drive(control, 1, pose, state)
        driven += command.speed * DT
        assert command.speed >= 0
        if control.mode(state) == ARRIVED:
            break
    assert control.mode(state) == ARRIVED
    assert driven < 1.2 * left


def test_the_same_state_gives_the_same_step_and_stays_as_it_was():
    control = GoalControl(RIG, DT, GoalParams(goal=(3.0, 0.0), reactive=SMALL))
    pose, state, command = drive(control, 30, place(0.0, 0.0, 0.0))
    kept = copy.deepcopy(state)
    one, two = (control.step(floor(), nothing(), pose, command, state) for _ in range(2))
    assert one[0] == two[0]
    assert np.array_equal(one[1].path, two[1].path)
    assert np.array_equal(kept.reactive.grid.evidence, state.reactive.grid.evidence)
    assert np.array_equal(kept.path, state.path)
    assert [part for part in kept[2:] if not isinstance(part, np.ndarray)] == [
        part for part in state[2:] if not isinstance(part, np.ndarray)
    ]


def test_what_is_ranged_in_the_way_is_driven_around():
    control = GoalControl(RIG, DT, GoalParams(goal=(3.0, 0.0), reactive=SMALL))
    pose, state, command = drive(control, 20, place(0.0, 0.0, 0.0))
    assert int(control.mode(state)) == CRUISE
    straight = state.path[: state.points]
    assert np.abs(straight[:, 1]).max() < 0.05
    x = 1.6 - pose.x
    across = (np.array([-0.1, -0.03, 0.03, 0.1]) - pose.y).astype(np.float32)
    wall = Ranges(across * 0, across * 0, across * 0, np.full(4, x, np.float32), across, np.ones(4, bool))
    for _ in range(10):
        command, state = control.step(floor(), wall, pose, command, state)
    way = state.path[: int(state.points)]
    beside = way[np.abs(way[:, 0] - 1.6) < 0.2]
    assert len(beside)
    assert np.abs(beside[:, 1]).min() > 0.3


@pytest.mark.parametrize("name", ["ranging", "published", "goal"])
def test_no_controller_is_told_to_go_faster_than_its_cruise_speed(name):
    params = NavigatorOptions(name, speed=0.25).make(RIG, DT).params
    assert params.speed_m_per_s == 0.25
    reactive = getattr(params, "reactive", params)
    for key in ("tight_speed_m_per_s", "reverse_speed_m_per_s", "unknown_speed_m_per_s"):
        assert getattr(params, key, 0) <= 0.25
        assert getattr(reactive, key, 0) <= 0.25


HERE = (0.0, 0.0, 0.0)


def test_a_place_is_reached_and_exploring_is_given_up_only_after_a_while():
    params = GoalParams(goal=(0.2, 0.0), explore=True, reactive=SMALL)
    control = GoalControl(RIG, DT, params)
    state = control.start(floor(), place(*HERE))
    assert int(next_task(state, (2.0, 0.0, 0.0), control.tasks, params).task) == GOAL
    state = next_task(state, HERE, control.tasks, params)
    assert int(state.task) == EXPLORE
    assert not is_fruitless(state)
    state = state._replace(cost=math.inf, fruitless_s=params.exploration_timeout_s - 0.1)
    assert is_fruitless(state)
    assert int(next_task(state, HERE, control.tasks, params).task) == EXPLORE
    state = next_task(state._replace(fruitless_s=params.exploration_timeout_s), HERE, control.tasks, params)
    assert int(state.task) == DONE
    assert float(state.fruitless_s) == 0


def test_where_no_floor_was_seen_yet_the_reactive_controller_drives_before_exploring_is_given_up():
    control = GoalControl(RIG, DT, GoalParams(explore=True, exploration_timeout_s=1.0, reactive=SMALL))
    pose, state, command = drive(control, 16, place(*HERE))  # standing and learning
    moved, steps = False, 0
    while int(control.mode(state)) != ARRIVED and steps < 60:
        # Cells that show nothing: neither floor nor its end is known.
        command, state = control.step(floor(moves=False), nothing(), pose, command, blind(state))
        moved, steps = moved or float(command.speed) > 0, steps + 1
    assert moved
    assert 28 <= steps <= 35


def test_goals_are_where_the_car_is_told_that_it_is():
    """Dead reckoning believes to have driven 10 % farther and has turned by a quarter too much."""
    params = GoalParams(goal=(2.0, 1.0), return_home=True, reactive=SMALL)
    control = GoalControl(RIG, DT, params)
    state = control.start(floor(), place(*HERE))
    reckons, is_at = place(1.1, 0.0, math.pi / 2), place(1.0, 0.0, 0.0)
    told = control.on_pose(state, reckons, is_at)
    # One metre ahead and one to the left, seen from the car, however it counts.
    assert task_goal(told, params) == pytest.approx((0.1, 1.0), abs=1e-5)
    assert int(next_task(told, (2.0, 1.0, 0.0), control.tasks, params).task) == GOAL
    assert int(next_task(told, (0.1, 1.0, 0.0), control.tasks, params).task) == HOME


@pytest.mark.slow
def blind(state):
    """Nothing is known of the surroundings."""
    grid = state.reactive.grid
    reactive = state.reactive._replace(grid=grid._replace(evidence=np.zeros_like(grid.evidence)))
    return state._replace(reactive=reactive)


def test_another_goal_takes_the_place_of_all_tasks():
    """Also of those that are done, and in the frame of the localiser."""
    control = GoalControl(RIG, DT, GoalParams(goal=(0.2, 0.0), return_home=True, reactive=SMALL))
    state = control.start(floor(), place(*HERE))._replace(task=DONE, mode=ARRIVED, frame=(1.0, 0.0, math.pi / 2))
    state = control.on_goal(state, (3.0, -1.5))
    assert (state.task, control.tasks, state.mode == ARRIVED) == (GOAL, [GOAL, DONE], False)
    assert task_goal(state, control.params) == pytest.approx((1.0 + 1.5, 3.0))
    assert next_task(state, HERE, control.tasks, control.params).task == GOAL


ORIGIN = (0.3, -0.2, 0.1)
REPLAN = GoalParams(goal=(2.0, 0.0), reactive=SMALL)


def known(evidence: float, params: GoalParams = REPLAN) -> GoalState:
    """All that is around the car was seen so far, in shares of what counts as blocked."""
    state = GoalControl(RIG, DT, params).start(floor(), place(*ORIGIN))
    grid = state.reactive.grid
    grid = grid._replace(evidence=np.full_like(grid.evidence, evidence * BLOCKED))
    return state._replace(reactive=state.reactive._replace(grid=grid))


def test_as_much_is_kept_as_was_planned_with_the_speeds_that_are_allowed() -> None:
    made = replan(known(-1.0), ORIGIN, REPLAN, 7)
    places = int(made.points)
    # Arcs of 0.2 m for 1.7 m, after the place where the car is.
    assert places == pytest.approx(1 + math.dist(ORIGIN[:2], (2.0, 0.0)) / REPLAN.planner.step_m, abs=1.5)
    assert not made.path[places:].any()
    assert float(made.cost) == pytest.approx(math.dist(ORIGIN[:2], (2.0, 0.0)), abs=0.15)
    speeds = made.path[:places, 5]
    assert float(speeds[0]) == REPLAN.speed_m_per_s
    assert bool((speeds > 0).all())


def test_what_is_blocked_is_driven_through_at_its_price_to_a_place_and_not_at_all_when_exploring() -> None:
    costs = [float(replan(known(evidence), ORIGIN, REPLAN, 7).cost) for evidence in (0.999, 1.0)]
    assert costs[0] < 4 < REPLAN.planner.obstacle_cost < costs[1]
    params = GoalParams(explore=True, reactive=SMALL)
    state = known(1.0, params)
    assert int(state.task) == EXPLORE
    made = replan(state, ORIGIN, params, 7)
    assert (float(made.points), math.isinf(float(made.cost))) == (0.0, True)


def on_the_way():
    """A controller that drives straight ahead, to a place 3 m away."""
    control = GoalControl(RIG, DT, GoalParams(goal=(3.0, 0.0), reactive=SMALL))
    pose, state, _ = drive(control, 20, place(0.0, 0.0, 0.0))
    reaction = Command(-0.1, 1.5)
    return control, pose, state, reaction


def test_a_way_that_is_refused_for_a_second_is_left_to_the_reactive_controller_for_a_second():
    control, pose, state, reaction = on_the_way()
    room = np.zeros((2, len(control.tables.arcs.curvature)), np.float32)
    second = round(1 / DT)
    for refused in range(1, second):
        command, state = control.drive(room, pose, reaction, state, False)
        assert (float(command.speed), int(state.vetoed), int(state.reactive_steps)) == (0.0, refused, 0)
        assert int(state.due) == 0  # another way is looked for at once
        assert int(control.mode(state)) == CRUISE
    _, state = control.drive(room, pose, reaction, state, False)
    assert (int(state.vetoed), int(state.reactive_steps)) == (0, second)
    for left in reversed(range(second)):
        command, state = control.drive(room, pose, reaction, state, False)
        assert (command, int(state.reactive_steps)) == (reaction, left)
    command, state = control.drive(room + 2.0, pose, reaction, state, False)
    assert float(command.speed) >= 0.3
    assert (int(state.vetoed), int(state.reactive_steps)) == (0, 0)


def test_speed_is_what_can_be_braked_from_in_the_room_there_is():
    """s = v t + v^2 / 2a, where the way itself allows more; nothing where v is less than 0.1 m/s."""
    control, pose, state, reaction = on_the_way()
    p, arcs = control.params, len(control.tables.arcs.curvature)
    state = state._replace(seen=state.points, due=9)
    for speed in (0.3, 0.2, 0.101, 0.099, 0.0):
        room = speed * p.reaction_s + speed**2 / (2 * p.deceleration_m_per_s2)
        command, after = control.drive(np.full((2, arcs), room, np.float32), pose, reaction, state, False)
        assert float(command.speed) == pytest.approx(speed if speed >= 0.1 else 0.0, rel=1e-4)
        assert after.margin == pytest.approx(0.0 if speed >= 0.1 else math.inf, abs=1e-6)


def test_speed_into_what_was_not_seen_is_braked_from_or_that_for_unknown_cells():
    control, pose, state, reaction = on_the_way()
    p, room = control.params, np.full((2, len(control.tables.arcs.curvature)), 9.0, np.float32)
    state = state._replace(path=state.path.copy(), seen=state.at + 2, due=9)
    for seen, speed in ((0.4 * p.reaction_s + 0.16 / (2 * p.deceleration_m_per_s2), 0.4), (0.01, 0.3)):
        state.path[state.at + 1, :2] = pose.x + seen, pose.y
        command, after = control.drive(room, pose, reaction, state, False)
        assert float(command.speed) == pytest.approx(speed, rel=1e-3)
        assert (after.margin < -0.05) == (seen < 0.1)


PARAMS = LocalGridParams(cell_m=0.05, size_cells=16)


def marked(car: tuple[float, float], x: list[float], y: list[float], weight: float, p: LocalGridParams) -> LocalGrid:
    grid = empty_grid(*car, p)
    grid.evidence.reshape(-1)[cells_at((*car, 0.0), x, y, p)] = weight
    return grid


@pytest.mark.parametrize("car", [(0.0, 0.0), (0.42, 3.17), (-1.33, 0.38), (2.51, -4.04)])
def test_what_is_seen_lies_where_it_is_in_the_world(car: tuple[float, float]) -> None:
    ahead, aside = 0.21, -0.13
    grid = marked(car, [ahead], [aside], 3.0, PARAMS)
    around = local_map(grid.evidence, *car, PARAMS, blocked=2.0, free=-0.5)
    assert around.blocked.shape == (16, 16)
    ((row, column),) = np.argwhere(around.blocked)
    assert 0 <= car[0] + ahead - (around.left + column * PARAMS.cell_m) < PARAMS.cell_m
    assert 0 <= car[1] + aside - (around.bottom + row * PARAMS.cell_m) < PARAMS.cell_m
    # The car is in the middle.
    assert abs(around.left + 8 * PARAMS.cell_m - car[0]) <= PARAMS.cell_m
    assert abs(around.bottom + 8 * PARAMS.cell_m - car[1]) <= PARAMS.cell_m
    assert not around.free.any()
    assert (visited_cells(grid.evidence, *car, PARAMS, PARAMS) == around.blocked).all()
