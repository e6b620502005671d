"""One step of the goal controller on its way: what it is refused, what it brakes for, when the other one drives."""

import math

import numpy as np
import pytest

from ndtorch.navigation import CRUISE, TURN, Command
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


def test_refusals_that_are_apart_are_not_added_up():
    control, pose, state, reaction = on_the_way()
    room = np.zeros((2, len(control.tables.arcs.curvature)), np.float32)
    for free in (0.0, 0.0, 2.0, 0.0):
        _, state = control.drive(room + free, pose, reaction, state, False)
    assert int(state.vetoed) == 1


def test_speed_is_what_can_be_braked_from_in_the_room_there_is():
    """v^2 = 2 a (s - lag), where the way itself allows more; nothing where that is less than 0.1 m/s."""
    control, pose, state, reaction = on_the_way()
    p, arcs = control.params, len(control.tables.arcs.curvature)
    lag = p.reaction_distance_m
    for room in (0.125, 0.12, lag + 0.0034, lag + 0.0033, lag, 0.05):
        command, _ = control.drive(np.full((2, arcs), room, np.float32), pose, reaction, state, False)
        safe = (2 * p.deceleration_m_per_s2 * max(0.0, room - lag)) ** 0.5
        assert float(command.speed) == pytest.approx(safe if safe >= 0.1 else 0.0, rel=1e-4)


def test_where_the_way_has_ended_it_stands_and_lets_the_other_drive_after_a_while():
    control, pose, state, reaction = on_the_way()
    room = np.full((2, len(control.tables.arcs.curvature)), 2.0, np.float32)
    ended = state._replace(at=state.points, due=5)
    for count in range(2 * control.every):
        command, after = control.drive(room, pose, reaction, ended._replace(vetoed=count), False)
        assert (float(command.speed), float(command.curvature)) == (0.0, 0.0)
        assert (after.due, after.vetoed, after.reactive_steps) == (0, count + 1, 0)
        assert control.mode(after) == TURN
    _, after = control.drive(room, pose, reaction, ended._replace(vetoed=2 * control.every), False)
    assert (int(after.vetoed), float(after.reactive_steps)) == (0, pytest.approx(1 / DT))


def test_exploring_counts_how_long_it_tries_and_how_long_it_finds_nothing():
    control = GoalControl(RIG, DT, GoalParams(explore=True, reactive=SMALL))
    pose, state, _ = drive(control, 20, place(0.0, 0.0, 0.0))
    room = np.full((2, len(control.tables.arcs.curvature)), 2.0, np.float32)
    reaction = Command(-0.1, 1.5)
    found = state._replace(cost=1.0, due=5, no_progress_s=3.0, reactive_steps=0)
    nothing = found._replace(cost=math.inf, fruitless_s=2.0)
    _, after = control.drive(room, pose, reaction, found._replace(fruitless_s=2.0), False)
    assert (after.no_progress_s, after.fruitless_s, after.reactive_steps) == (pytest.approx(3 + DT), 0.0, 0)
    command, after = control.drive(room, pose, reaction, nothing, False)
    assert command == reaction
    assert (float(after.fruitless_s), float(after.reactive_steps)) == pytest.approx((2 + DT, 1 / DT - 1))
    # The time for which the other drives is not begun anew at every step.
    _, after = control.drive(room, pose, reaction, nothing._replace(reactive_steps=4), False)
    assert (float(after.fruitless_s), float(after.reactive_steps)) == pytest.approx((2 + DT, 3.0))


def test_while_it_looks_for_itself_the_other_drives_and_nothing_is_planned():
    control, pose, state, reaction = on_the_way()
    room = np.full((2, len(control.tables.arcs.curvature)), 2.0, np.float32)
    state = state._replace(localised=-1, due=5, no_progress_s=1.0)
    state = state._replace(reactive=state.reactive._replace(mode=TURN))
    command, after = control.drive(room, pose, reaction, state, False)
    assert command == reaction
    assert (float(after.due), int(control.mode(after)), float(after.no_progress_s)) == (0.0, TURN, 1.0)
    # While it learns the floor nothing else is counted either.
    assert control.drive(room, pose, reaction, state, True) == (reaction, state)


def test_room_is_that_of_the_longer_of_the_two_arcs_beside_what_is_wanted():
    control = on_the_way()[0]
    arcs = control.tables.arcs
    lengths = np.stack(([0.7, 0.3, 0.9, 0.2, 0.6, 0.4, 0.8, 0.5], np.zeros(8)))
    for direction in (1.0, -1.0):
        own = np.flatnonzero(arcs.forward == direction)
        for curvature in (-3.0, -1.3, -0.4, 0.1, 0.9, 1.7):
            near = own[np.abs(arcs.curvature[own] - curvature).argsort()[:2]]
            assert control.free_ahead(lengths, direction, curvature) == float(lengths[0, near].max())
