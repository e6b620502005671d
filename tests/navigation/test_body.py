"""Lengths follow the body: a robot of another size in a world of its size does the same in its own units."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import (
    CRUISE,
    Body,
    Command,
    DeadReckoning,
    MatchParams,
    Navigator,
    Pose,
    RangingParams,
    SearchParams,
    StereoRig,
)
from ndtorch.navigation.body import SPOT_RADIUS
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.proximity import NOWHERE, Obstacles, ProximityScan
from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.sim.plan import Plan, ring
from ndtorch_robot.sim.simulation import Simulation

RIG = StereoRig(forward=0.15)


@pytest.mark.parametrize(
    ("controller", "unit"), [("ranging", 0.25), ("ranging", 4.0), ("goal", 4.0), ("published", 0.25)]
)
def test_a_body_of_another_size_does_the_same_in_its_units(controller: str, unit: float) -> None:
    """Worlds that differ in size alone look the same: what one robot sees on a drive, another one is shown."""
    body, rig = Body(0.5 * unit, 0.36 * unit, 0.45 * unit, unit, 2.5 * unit), RIG.in_units(1 / unit)
    assert body.unit_m == unit
    usual = Navigator(RIG, 1 / 30, controller=controller)
    scaled = Navigator(rig, 1 / 30, controller=controller, body=body)
    plan = Plan("small", ring([(0, 0), (4, 0), (4, 3), (0, 3)]))
    simulation = Simulation(plan, 3, rig=RIG, fields=usual.controller.fields)
    state = after = driven = moved = None
    commands = []
    try:
        simulation.place(1.0, 1.5, 0.0)
        for step in range(120):
            frames = simulation.read()
            command, state = usual(frames.left, frames.right, state, driven)
            other, after = scaled(frames.left, frames.right, after, moved)
            commands.append((float(command.speed), float(command.curvature)))
            assert float(other.speed) == pytest.approx(float(command.speed) * unit, rel=1e-5)
            assert float(other.curvature) == pytest.approx(float(command.curvature) / unit, rel=1e-5)
            simulation.obey(DriveCommand(*commands[-1]))
            simulation.wait_until((step + 1) / 30)
            speed, curvature = simulation.driven()
            driven = Command(torch.tensor([speed]), torch.tensor([curvature]))
            moved = Command(torch.tensor([speed * unit]), torch.tensor([curvature / unit]))
    finally:
        simulation.close()
    assert max(speed for speed, _ in commands) > 0.3
    assert controller != "ranging" or any(curvature for _, curvature in commands)
    assert after.pose.x == pytest.approx(state.pose.x * unit, rel=1e-4)


def test_what_the_usual_body_has_is_what_there_is_without_one() -> None:
    assert MatchParams.for_body(RIG, Body()) == MatchParams()
    assert SearchParams.for_body(RIG, Body(), 3) == SearchParams()
    assert Navigator(RIG, 1 / 30, body=Body()).controller.params == Navigator(RIG, 1 / 30).controller.params


def test_speed_is_what_stops_in_the_length_in_which_the_usual_body_does() -> None:
    """Reaction and braking: v t + v^2 / 2 a, a tenth of a unit."""
    assert Body().cruise_m_per_s == pytest.approx(0.5)
    for body in (Body(), Body(max_acceleration_m_per_s2=0.5), Body(0.25, 0.18, 0.225, 1.0, 0.3, 0.3)):
        v = body.cruise_m_per_s
        way = v * body.reaction_s + v**2 / (2 * body.max_acceleration_m_per_s2)
        assert way == pytest.approx(0.1 * body.unit_m)
        rig = RIG.in_units(1 / body.unit_m)
        params = Navigator(rig, 1 / 30, body=body).controller.params
        assert params.speed_m_per_s * body.unit_m == pytest.approx(v)
    assert Body(max_speed_m_per_s=0.2).cruise_m_per_s == 0.2


def test_a_differential_drive_turns_on_the_spot_where_others_back() -> None:
    """A wall ahead, floor all around: the car that knows its floor backs, and the one that can turns."""
    pose, wall = Pose(0.0, 0.0, 0.0), np.linspace(-0.8, 0.8, 40, dtype=np.float32)
    speeds = []
    for radius in (0.45, 0.0):
        control = RangingControl(RIG, 1 / 30, RangingParams(body=Body(min_turn_radius_m=radius)))
        state = control.start(None, pose)
        floor = state.floor._replace(level=np.ones_like(state.floor.level), age=1000)
        seen = state.grid._replace(evidence=np.full_like(state.grid.evidence, -2.0))
        state = state._replace(floor=floor, grid=seen, mode=CRUISE)
        blocked = Obstacles(np.full_like(wall, 0.52), wall)
        state = control.on_near_obstacles(state, pose, ProximityScan(blocked, True, blocked, NOWHERE))
        cells = np.zeros((4, *control.view.x.shape[1:]), np.float32)
        nothing = Ranges(*[np.zeros(1, np.float32)] * 5, np.zeros(1, bool))
        command, state = control.step(cells, nothing, pose, Command(0.0, 0.0), state)
        speeds.append((command.speed, abs(command.curvature)))
    assert speeds[0][0] < 0
    assert speeds[1] == (pytest.approx(0.8 * SPOT_RADIUS), pytest.approx(1 / SPOT_RADIUS))


def test_a_small_robot_and_one_whose_cameras_see_too_little_floor() -> None:
    robot = Body(0.12, 0.1, 0.0)
    rig = StereoRig(0.06, 215.0, 320, 240, camera_height=0.06)
    navigator = Navigator(rig, 1 / 30, body=robot)
    assert navigator.ranging.matching.max_disparity_px == pytest.approx(200 * 0.06 * 215 / 129 / robot.unit_m)
    with pytest.raises(InputError, match=r"lengths in units of the body, 0.278 m"):
        Navigator(replace(rig, camera_height=0.5), 1 / 30, body=robot)


def test_circle_and_line():
    turn = torch.full((60,), 2.0, dtype=torch.float64)
    speed = torch.full((60,), math.pi / 2, dtype=torch.float64)  # radius 0.5 m: a full circle in 2 s
    poses, last = DeadReckoning(1 / 30)(speed, turn)
    assert [float(v) for v in last] == pytest.approx([0, 0, 2 * math.pi], abs=1e-9)
    assert [float(part[29]) for part in poses] == pytest.approx([0, 1.0, math.pi])  # half way: 1 m to the left
    straight = DeadReckoning(1 / 30)(speed, 0 * turn, Pose(*torch.tensor([1.0, 2.0, math.pi / 2]).double()))[1]
    assert [float(v) for v in straight] == pytest.approx([1.0, 2.0 + math.pi, math.pi / 2])
