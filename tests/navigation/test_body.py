"""Lengths follow the body: a robot of another size in a world of its size does the same in its own units."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Body, Command, Navigator, StereoRig
from ndtorch.navigation.body import match_params, rig_in_units, search_params
from ndtorch.navigation.stereo.correspondence import MatchParams
from ndtorch.navigation.stereo.search import SearchParams
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.sim.plan import Plan, ring
from ndtorch_robot.sim.simulation import Simulation

RIG = StereoRig(forward=0.15)


@pytest.mark.parametrize("controller", ["ranging", "goal", "published"])
@pytest.mark.parametrize("unit", [0.25, 4.0])
def test_a_body_of_another_size_does_the_same_in_its_units(controller: str, unit: float) -> None:
    """Worlds that differ in size alone look the same: what one robot sees on a drive, another one is shown."""
    body, rig = Body(0.5 * unit, 0.36 * unit, 0.45 * unit), rig_in_units(RIG, 1 / unit)
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
    assert match_params(RIG, Body()) == MatchParams()
    assert search_params(RIG, Body(), 3) == SearchParams()
    assert Navigator(RIG, 1 / 30, body=Body()).controller.params == Navigator(RIG, 1 / 30).controller.params


def test_a_small_robot_and_one_whose_cameras_see_too_little_floor() -> None:
    robot = Body(0.12, 0.1, 0.0)
    rig = StereoRig(0.06, 215.0, 320, 240, camera_height=0.06)
    navigator = Navigator(rig, 1 / 30, body=robot)
    assert navigator.ranging.matching.max_disparity_px == pytest.approx(200 * 0.06 * 215 / 129 / robot.unit_m)
    with pytest.raises(InputError, match=r"do not fit.*mount the cameras at most"):
        Navigator(replace(rig, camera_height=0.5), 1 / 30, body=robot)
    with pytest.raises(InputError, match="body belongs to a controller that is named"):
        Navigator(rig, 1 / 30, controller=navigator.controller, body=robot)
