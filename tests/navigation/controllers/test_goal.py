"""The goal controller: what it is asked to do, and that its state is all it has."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ndtorch.navigation import ARRIVED, CRUISE, Body, Command, Pose, StereoRig
from ndtorch.navigation.controllers.goal import (
    DONE,
    GOAL,
    HOME,
    REACTION_S,
    STUCK_S,
    GoalControl,
    GoalParams,
    next_task,
)
from ndtorch.navigation.local_grid import LocalGridParams, cell_index, empty_grid, unrolled
from ndtorch.navigation.odometry import arc
from ndtorch.navigation.stereo.ranging import Ranges

RIG, DT = StereoRig(forward=0.15), 1 / 30
HOME_POSE = Pose(0.0, 0.0, 0.0)


def made(**params):
    return GoalControl(RIG, DT, GoalParams(map_cells=128, **params))


def nothing():
    blank = np.zeros(4, np.float32)
    return Ranges(blank, blank, blank, blank, blank, blank > 0)


def floor(moves=True):
    """What open floor gives while the car moves at a steady speed, roughly; nothing while it stands."""
    return np.full((2, 14, 8), 0.5 if moves else 0.0, np.float32)


def drive(control, steps, pose=HOME_POSE, state=None):
    """Through open floor: the commands are obeyed at once."""
    command = Command(0.0, 0.0)
    state = control.start(floor(), pose) if state is None else state
    for _ in range(steps):
        command, state = control.step(floor(moves=command.speed != 0), nothing(), pose, command, state)
        pose = arc(pose, *command, DT)
    return pose, state, command


def test_it_drives_to_the_goal_and_back_and_stands():
    control, state, pose, nearest = made(goal=(1.5, 0.5), return_home=True), None, HOME_POSE, 9.0
    for _ in range(60):
        pose, state, command = drive(control, 10, pose, state)
        nearest = min(nearest, math.hypot(pose.x - 1.5, pose.y - 0.5))
        if control.mode(state) == ARRIVED:
            break
    assert nearest < 0.5
    assert math.hypot(pose.x, pose.y) < 0.35
    assert command.speed == 0


@pytest.mark.parametrize("goal", [(-1.5, 0.2), (-0.3, -1.5)])
def test_a_differential_drive_turns_on_the_spot_to_a_goal_behind_it(goal):
    """It drives ahead alone, and little more than the distance."""
    control = made(goal=goal, body=Body(min_turn_radius_m=0.0))
    pose, state, command = drive(control, 20)
    left, driven = math.dist(pose[:2], goal), 0.0
    for _ in range(600):
        pose, state, command = drive(control, 1, pose, state)
        driven += command.speed * DT
        assert command.speed >= 0
        if control.mode(state) == ARRIVED:
            break
    assert control.mode(state) == ARRIVED
    assert driven < 1.2 * left


def test_a_ranged_wall_is_driven_around():
    control = made(goal=(3.0, 0.0))
    pose, state, command = drive(control, 20)
    assert control.mode(state) == CRUISE
    assert np.abs(state.path[: state.points, 1]).max() < 0.05
    across = (np.array([-0.1, -0.03, 0.03, 0.1]) - pose.y).astype(np.float32)
    wall = Ranges(across * 0, across * 0, across * 0, np.full(4, 1.6 - pose.x, np.float32), across, np.ones(4, bool))
    for _ in range(10):
        command, state = control.step(floor(), wall, pose, command, state)
    path = state.path[: state.points]
    beside = path[np.abs(path[:, 0] - 1.6) < 0.2]
    assert len(beside)
    assert np.abs(beside[:, 1]).min() > 0.3


def blind(state):
    """Nothing is known of the surroundings."""
    grid = state.reactive.grid
    reactive = state.reactive._replace(grid=grid._replace(evidence=np.zeros_like(grid.evidence)))
    return state._replace(reactive=reactive)


def test_exploring_without_known_floor_the_reactive_controller_drives_before_it_ends():
    control = made(explore=True)
    pose, state, command = drive(control, 16)  # standing and learning
    moved, steps = False, 0
    while control.mode(state) != ARRIVED and steps < 400:
        # Cells that show nothing: neither floor nor its end is known.
        command, state = control.step(floor(moves=False), nothing(), pose, command, blind(state))
        moved, steps = moved or command.speed > 0, steps + 1
    assert moved
    assert steps * DT == pytest.approx(10.0, abs=0.2)


def test_goals_are_in_the_frame_of_the_map():
    """Dead reckoning believes to have driven 10 % farther and has turned by a quarter too much."""
    control = made(goal=(2.0, 1.0), return_home=True)
    state = control.start(floor(), HOME_POSE)
    state = control.on_pose(state, Pose(1.1, 0.0, math.pi / 2), Pose(1.0, 0.0, 0.0))
    # One metre ahead and one to the left of the car, in either frame
    assert control.task_goal(state) == pytest.approx((0.1, 1.0), abs=1e-5)
    assert control.task_goal(state._replace(task=HOME)) == pytest.approx((1.1, -1.0), abs=1e-5)


def test_another_goal_takes_the_place_of_all_tasks_and_belongs_to_the_state():
    control = made(goal=(0.2, 0.0), return_home=True)
    before = control.start(floor(), HOME_POSE)._replace(task=DONE, mode=ARRIVED, frame=(1.0, 0.0, math.pi / 2))
    state = control.on_goal(before, (3.0, -1.5))
    assert (state.task, next_task(state).task, state.mode == ARRIVED) == (GOAL, DONE, False)
    assert control.task_goal(state) == pytest.approx((1.0 + 1.5, 3.0))
    assert control.task_goal(before._replace(task=GOAL)) == pytest.approx((1.0, 0.2))


def on_a_path():
    """A controller that drives straight ahead, to a goal 3 m away."""
    control = made(goal=(3.0, 0.0))
    pose, state, _ = drive(control, 20)
    return control, pose, state, Command(-0.1, 1.5)


def test_a_path_that_is_blocked_for_a_second_is_left_to_the_reactive_controller_for_a_second():
    control, pose, state, reaction = on_a_path()
    room = np.zeros((2, len(control.tables.arcs.curvature)), np.float32)
    second = round(STUCK_S / DT)
    for _ in range(second):
        command, state = control.drive(room, pose, reaction, state)
        assert (command.speed, state.due) == (0.0, 0)  # another path is looked for at once
    for _ in range(second):
        command, state = control.drive(room, pose, reaction, state)
        assert command == reaction
    command, state = control.drive(room + 2.0, pose, reaction, state)
    assert command.speed >= 0.3
    assert (state.stuck, state.reactive_steps) == (0, 0)


def test_speed_is_what_can_be_braked_from_in_the_room_there_is():
    """s = v t + v^2 / 2a, where the path itself allows more; nothing where v is less than 0.1 m/s."""
    control, pose, state, reaction = on_a_path()
    p, arcs = control.params, len(control.tables.arcs.curvature)
    for speed in (0.3, 0.2, 0.101, 0.099, 0.0):
        room = speed * REACTION_S + speed**2 / (2 * p.deceleration_m_per_s2)
        command, _ = control.drive(np.full((2, arcs), room, np.float32), pose, reaction, state._replace(due=9))
        assert command.speed == pytest.approx(speed if speed >= 0.1 else 0.0, rel=1e-4)


@pytest.mark.parametrize("car", [(0.0, 0.0), (0.42, 3.17), (-1.33, 0.38), (2.51, -4.04)])
def test_unrolled_evidence_lies_where_it_is_in_the_world(car):
    params = LocalGridParams(cell_m=0.05, size_cells=16)
    grid = empty_grid(*car, params)
    place = (np.array([part], np.float32) for part in (0.21, -0.13))
    grid.evidence.reshape(-1)[cell_index(*place, (*car, 0.0), 0.05, 16)] = 3.0
    cells, left, bottom = unrolled(grid.evidence, *car, params)
    ((row, column),) = np.argwhere(cells)
    assert 0 <= car[0] + 0.21 - (left + column * 0.05) < 0.05
    assert 0 <= car[1] - 0.13 - (bottom + row * 0.05) < 0.05
    # The car is in the middle.
    assert abs(left + 8 * 0.05 - car[0]) <= 0.05
    assert abs(bottom + 8 * 0.05 - car[1]) <= 0.05
