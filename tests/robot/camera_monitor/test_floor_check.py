"""What is said of a floor before anything drives, beside what a drive learns of it."""

from itertools import count

import numpy as np
import pytest

from ndtorch.navigation.options import NavigatorOptions
from ndtorch.navigation.stereo.strips import strips
from ndtorch_robot.camera_monitor.floor_check import measure_floor, moved_level
from ndtorch_robot.camera_monitor.frame_check import FrameCheck
from ndtorch_robot.car import Car
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.safety import SafeDrive, SafetyLimits
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.simulation import RIG, Simulation

LIMITS = SafetyLimits(speed=0.6, curvature=2.2, silence=0.1, age=0.1)


def reading(world):
    """Frames of a car that stands."""
    moments = count(1)

    def read():
        world.wait_until(next(moments) / 30)
        return world.read()

    return read


@pytest.mark.slow
def test_the_level_is_the_one_that_driving_teaches():
    runner = NavigatorRunner(NavigatorOptions(), RIG, 30.0)
    world = Simulation(load_arena("dead-end", 3), 3, fields=runner.fields)
    try:
        frames = world.read()
        told = moved_level(runner.navigator.controller, strips(frames.left), strips(frames.right), RIG)
        check = FrameCheck(RIG, 30.0, LIMITS.age, joint_freeze=False)
        Car(runner, world, SafeDrive(world, world, LIMITS, check)).run(0.8, warm_up=False)
        learned = runner.state.control.floor.level
        assert np.abs(np.log(told[:6] / learned[:6])).max() < 0.4
    finally:
        world.close()


@pytest.mark.slow
def test_smooth_floor_will_not_do():
    world = Simulation(load_arena("smooth", 3), 3, fields=NavigatorOptions().fields(RIG))
    try:
        found = measure_floor(reading(world), RIG, 30.0)
    finally:
        world.close()
    assert not found.good
    assert not found.ahead
    assert found.speed == 0
    assert "the floor shows little" in found.words()[0]
