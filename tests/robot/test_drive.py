"""Whole drives: determinism, restarts, Ctrl-C, and the published figures."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import STOPPED
from ndtorch.navigation.options import NavigatorOptions
from ndtorch.navigation.stereo.strips import Strips
from ndtorch_robot.camera_monitor import CameraMonitor
from ndtorch_robot.car import Car
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import DRAWN, drive
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.plan import Plan, ring
from ndtorch_robot.sim.simulation import RIG, Simulation

LIMITS = DriveConfig().robot_config.simulated_limits
pytestmark = pytest.mark.slow


def straight(command):
    return DriveCommand(0.5, 0.0)


def same(a, b):
    for name in ("time", "pose", "believed", "command", "sides", "difference", "mode", "ranges"):
        assert np.array_equal(a.record.array(name), b.record.array(name)), name
    assert np.array_equal(a.record.rows, b.record.rows)
    assert torch.equal(a.cells, b.cells)
    volatile = ("wall_seconds", "step_ms", "parts_ms")
    assert {k: v for k, v in a.summary.items() if k not in volatile} == {
        k: v for k, v in b.summary.items() if k not in volatile
    }


def test_same_seed_same_drive():
    config = DriveConfig(arena="room", seed=1, seconds=6, controller="published")
    first = drive(config)
    assert first.summary["collisions"] + first.summary["turns"] > 0
    same(first, drive(config))
    other = drive(replace(config, seed=2, seconds=1.0))
    assert (other.record.array("pose") != first.record.array("pose")[:30]).any()


def test_looking_changes_nothing(tmp_path):
    config = DriveConfig(arena="curve", seed=1, seconds=0.5)
    same(drive(config), drive(replace(config, rrd=tmp_path / "drive.rrd")))


def test_collision_restarts_and_keeps_the_map():
    result = drive(DriveConfig(arena="curve", seed=21, seconds=11, controller="published"), steer=straight)
    assert result.summary["collisions"] >= 1
    hit = result.simulation.collisions[0]
    before = math.ceil(hit.time * 30 - 1e-6) - 1  # the last frame that was taken
    record = result.record
    assert record.placed[:2] == [0, before + 1]
    jump = np.hypot(*(record.array("pose")[before + 1, :2] - record.array("pose")[before - 1, :2]))
    assert jump > 0.1
    assert np.abs(record.array("pose")[-1] - record.array("believed")[-1]).max() < 5e-3
    assert not record.array("ranges")[before + 1, 3].any()  # nothing is compared with what was seen before
    assert result.summary["distance_m"] < 0.5 * 11


def test_published_rule_in_the_curve():
    """A4: it drives on, for minutes in `ndtorch reproduce A4`; with reversed turns it collides within 8 s."""
    result = drive(DriveConfig(arena="curve", seed=11, seconds=18, controller="published"))
    assert result.summary["collisions"] == 0
    assert result.summary["turns"] >= 2
    # True odometry is true.
    assert np.abs(result.record.array("pose") - result.record.array("believed")).max() < 2e-3
    wrong = drive(
        DriveConfig(arena="curve", seed=11, seconds=8, controller="published"),
        steer=lambda c: DriveCommand(c.speed, -c.curvature),
    )
    assert wrong.summary["collisions"] >= 1


def test_a_car_that_sees_only_blank_wall_has_stopped(monkeypatch):
    """It is put elsewhere, and the drive goes on; cameras that give nothing end it."""
    seen = Simulation.read

    def blank(simulation):
        frames = seen(simulation)
        left, right = (
            Strips(torch.full_like(eye.field, 128), torch.full_like(eye.row, 128))
            for eye in (frames.left, frames.right)
        )
        return frames._replace(left=left, right=right)

    monkeypatch.setattr(Simulation, "read", blank)
    result = drive(DriveConfig(arena="room", seconds=5, controller="published"))
    assert result.summary["simulated_seconds"] == 5
    assert result.stops[-1] == pytest.approx(4.0, abs=0.1)  # two seconds are allowed, for two it stood
    assert any("shows nothing" in why for why in result.summary["faults"])

    def none(simulation):
        raise InputError("the left camera gives no frames")

    monkeypatch.setattr(Simulation, "read", none)
    with pytest.raises(InputError, match="gives no frames"):
        drive(DriveConfig(arena="room", seconds=1, controller="published"))


BUMPER = 0.25
"""Metres from the middle of the car."""


def driven(simulation, runner, place, seconds):
    """Put the car there, drive, and count the collisions."""
    simulation.place(*place)
    frame_check = CameraMonitor(RIG, 30.0, LIMITS.frame_age_s, DRAWN, rendered=True)
    car = Car(runner, simulation, SafeDrive(simulation, simulation, LIMITS, frame_check), max_steps=round(30 * seconds))
    before = len(simulation.collisions)
    car.run(warm_up=False)
    return len(simulation.collisions) - before, car


def test_a_start_before_a_wall_and_one_before_none():
    runner = NavigatorRunner(NavigatorOptions(), RIG, 30.0)
    simulation = Simulation(Plan("small", ring([(0, 0), (3, 0), (3, 2), (0, 2)])), 7, fields=runner.fields)
    hits, car = driven(simulation, runner, (3 - BUMPER - 0.35, 1.0, 0.0), 1.0)
    assert hits == 0
    assert simulation.pose[0] == pytest.approx(3 - BUMPER - 0.35)
    assert runner.mode() == STOPPED
    assert "it cannot begin" in car.troubles[0]
    hits, car = driven(simulation, runner, (0.6, 1.0, 0.0), 1.0)
    assert hits == 0
    assert car.troubles == []
    assert simulation.pose[0] > 0.8
