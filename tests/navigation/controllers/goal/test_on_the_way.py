"""One step of the goal controller on its way: what it is refused, what it brakes for, when the other one drives."""

import math

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
