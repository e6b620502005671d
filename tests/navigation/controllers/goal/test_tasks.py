"""The tasks of the goal controller, and when they are done."""

import math

import numpy as np
import pytest

from ndtorch.navigation import ARRIVED
from ndtorch.navigation.controllers.goal import GoalControl, GoalParams
from ndtorch.navigation.controllers.goal.replanning import replan
from ndtorch.navigation.controllers.goal.tasks import (
    DONE,
    EXPLORE,
    GOAL,
    HOME,
    is_fruitless,
    next_task,
    task_goal,
    with_pose,
)
from ndtorch.navigation.local_grid.grid import cells_at, empty_grid
from tests.navigation.controllers.goal.test_goal_control import DT, RIG, SMALL, drive, floor, nothing, place

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


def test_an_uncertain_place_slows_the_car_and_widens_its_footprint():
    """The middle of a gap is 25 cm from the cells of the wall; 24 cm are enough, 29 cm are not."""
    control = GoalControl(RIG, DT, GoalParams(goal=(2.0, 0.0), reactive=SMALL))
    pose, state, fast = drive(control, 40, place(0.0, 0.0, 0.0))
    slow, _ = control.step(floor(), nothing(), pose, fast, control.on_pose(state, pose, pose, 1.0))
    assert slow.speed == pytest.approx(0.4 * fast.speed, rel=0.02)
    grid = empty_grid(0.0, 0.0, SMALL.grid)
    grid.evidence[:] = -2.0
    y = np.arange(0.26, 3.1, 0.05)
    y = np.concatenate((y, -y))
    grid.evidence.reshape(-1)[cells_at((0.0, 0.0, 0.0), np.full_like(y, 1.2), y, SMALL.grid)] = 5.0
    start = control.start(floor(), place(0.0, 0.0, 0.0))
    start = start._replace(reactive=start.reactive._replace(grid=grid))
    for uncertain, fits in ((0.0, True), (0.05, False)):
        state = replan(start._replace(uncertain_m=uncertain), (0.0, 0.0, 0.0), control.params, 6)
        assert (state.path[: state.points, 0].max(initial=0.0) > 1.5) == fits


@pytest.mark.slow
def test_while_the_car_looks_for_itself_in_a_known_map_no_goal_is_reached_and_home_stays_where_it_was():
    params = GoalParams(goal=(0.0, 0.0), return_home=True, reactive=SMALL)
    control = GoalControl(RIG, DT, params)
    pose, _, _ = drive(control, 20, place(*HERE))
    state = with_pose(control.start(floor(), place(*HERE)), pose, None)
    assert int(next_task(state, HERE, control.tasks, params).task) == GOAL
    _, after, _ = drive(control, 20, pose, state)
    assert int(after.points) == 0
    # Found: the car is at 5, 5 and heads along y. Where it began lies behind it.
    found = with_pose(state, place(1.0, 0.0, 0.0), place(5.0, 5.0, math.pi / 2))
    assert found.home == pytest.approx([5.0, 4.0], abs=1e-5)
    assert task_goal(found._replace(task=HOME), params) == pytest.approx((0, 0), abs=1e-5)
    # Later corrections move it with the building.
    later = with_pose(found, place(1.0, 0.0, 0.0), place(5.0, 5.5, math.pi / 2))
    assert later.home == pytest.approx([5.0, 4.0], abs=1e-5)


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
