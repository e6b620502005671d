"""The goal controller: what it is asked to do, and that its state is all it has."""

import copy
import math
from dataclasses import replace

import numpy as np
import pytest

from ndtorch.navigation import ARRIVED, CRUISE, Body, Command, NavigatorOptions, Pose, StereoRig
from ndtorch.navigation.controllers.goal import GoalControl, GoalParams
from ndtorch.navigation.controllers.goal.params import reactive_params
from ndtorch.navigation.local_grid.grid import LocalGridParams
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
