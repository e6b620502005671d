"""One step of the goal controller on its way: what it is refused, what it brakes for, when the other one drives."""

import numpy as np
import pytest

from ndtorch.navigation import CRUISE, Command
from ndtorch.navigation.controllers.goal import GoalControl, GoalParams
from tests.navigation.controllers.goal.test_goal_control import DT, RIG, SMALL, drive, place


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
    assert float(command.speed) > 0.3
    assert (int(state.vetoed), int(state.reactive_steps)) == (0, 0)


def test_speed_is_what_can_be_braked_from_in_the_room_there_is():
    """v^2 = 2 a (s - lag), where the way itself allows more; nothing where that is less than 0.1 m/s."""
    control, pose, state, reaction = on_the_way()
    p, arcs = control.params, len(control.tables.arcs.curvature)
    lag = p.reaction_distance_m
    for room in (0.125, 0.12, lag + 0.0034, lag + 0.0033, lag, 0.05):
        command, _ = control.drive(np.full((2, arcs), room, np.float32), pose, reaction, state, False)
        safe = (2 * p.deceleration_m_per_s2 * max(0.0, room - lag)) ** 0.5
        assert float(command.speed) == pytest.approx(safe if safe >= 0.1 else 0.0, rel=1e-4)
