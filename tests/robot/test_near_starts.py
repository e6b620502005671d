"""A car that is started, or goes on after a fault, with a wall right before it."""

import math

import numpy as np
import pytest

from ndtorch.navigation import STOPPED, Navigator, StereoRig
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.camera_monitor.frame_check import FrameCheck
from ndtorch_robot.car import Car
from ndtorch_robot.config import LIMITS
from ndtorch_robot.drive import DRAWN
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import DriveCommand
from ndtorch_robot.safety import SafeDrive
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.plan import Plan, ring
from ndtorch_robot.sim.simulation import RIG, Simulation

pytestmark = pytest.mark.slow

BUMPER = 0.25
"""Metres from the middle of the car."""


def driven(simulation, runner, place, seconds):
    """Put the car there, drive, and count the collisions."""
    simulation.place(*place)
    frame_check = FrameCheck(RIG, 30.0, LIMITS.age, 15, joint_freeze=False, limits=DRAWN)
    car = Car(runner, simulation, SafeDrive(simulation, simulation, LIMITS, frame_check), max_steps=round(30 * seconds))
    before = len(simulation.collisions)
    car.run(warm_up=False)
    return len(simulation.collisions) - before, car


def test_a_start_before_a_wall_and_one_before_none():
    runner = NavigatorRunner(NavigatorOptions(), RIG, 30.0)
    simulation = Simulation(Plan("small", ring([(0, 0), (3, 0), (3, 2), (0, 2)])), 7, fields=runner.fields)
    try:
        hits, car = driven(simulation, runner, (3 - BUMPER - 0.35, 1.0, 0.0), 1.0)
        assert hits == 0
        assert simulation.pose[0] == pytest.approx(3 - BUMPER - 0.35)
        assert runner.mode() == STOPPED
        assert "it cannot begin" in car.troubles[0]
        hits, car = driven(simulation, runner, (0.6, 1.0, 0.0), 1.0)
        assert hits == 0
        assert car.troubles == []
        assert simulation.pose[0] > 0.8
    finally:
        simulation.close()


@pytest.mark.parametrize("seed", range(2))
def test_a_navigator_with_its_defaults_starts_20_cm_before_a_wall(seed):
    """The lines of README, and nothing of the car's own loop."""
    rig = StereoRig(baseline=0.30, focal=430.0, width=640, height=480)
    navigator = Navigator(rig, dt=1 / 30)
    plan = Plan("small", ring([(0, 0), (3, 0), (3, 2), (0, 2)]))
    simulation, state = Simulation(plan, seed, rig=rig, fields=navigator.controller.fields), None
    try:
        simulation.place(3 - BUMPER - 0.2, 1.0, 0.0)
        for step in range(90):
            frames = simulation.read()
            command, state = navigator(frames.left, frames.right, state)
            simulation.obey(DriveCommand(float(command.speed), float(command.curvature)))
            simulation.wait_until((step + 1) / 30)
        assert simulation.collisions == []
    finally:
        simulation.close()


@pytest.mark.long
@pytest.mark.parametrize("arena", ["room", "office"])
def test_twenty_starts_before_walls(arena):
    plan, rng = load_arena(arena, 1110), np.random.default_rng(1110)
    runner = NavigatorRunner(NavigatorOptions(), RIG, 30.0)
    simulation = Simulation(plan, 1110, fields=runner.fields)
    made = 0
    try:
        while made < 10:
            left, right, bottom, top = plan.bounds
            x, y, heading = rng.uniform(left, right), rng.uniform(bottom, top), rng.uniform(0, 2 * math.pi)
            if plan.clearance(np.array([[x, y]]))[0] < 0.33:
                continue
            free = float(simulation.spawn_points.lengths(x, y, np.array([heading]), 0.18)[0]) - BUMPER
            if not 0.2 <= free <= 0.6:
                continue
            made += 1
            runner.state = None
            hits, _ = driven(simulation, runner, (x, y, heading), 2.5)
            assert hits == 0, (x, y, heading, free)
    finally:
        simulation.close()
