"""Stresses of simulated drives: text to numbers, light, optics, timing, steering, odometer."""

import itertools
import math

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Rect, Strips
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.sim.car import Car
from ndtorch_robot.sim.plan import Plan, ring
from ndtorch_robot.sim.simulation import RIG, Simulation
from ndtorch_robot.sim.stress import STRESSES, Stress, read_stress
from ndtorch_robot.sim.stress.actuators import Delay, Odometer
from ndtorch_robot.sim.stress.light import Light
from ndtorch_robot.sim.stress.optics import Motion, axes, moved, slices
from ndtorch_robot.sim.stress.timing import FrameTiming
from tests.robot.support.gl_needed import needs_gl


def test_text():
    assert read_stress("") == Stress()
    assert read_stress("").none
    assert read_stress("noise,pitch=-2,late=0.05") == Stress(noise=0.05, pitch=-2, late=0.05)
    assert all(not read_stress(name).none for name in STRESSES)
    assert len({read_stress(name) for name in STRESSES}) == len(STRESSES)
    for text, words in (
        ("nois", "no stress 'nois'"),
        ("nois=1", "noise"),
        ("noise=2", "less than or equal to 1|0 to 1|1"),
    ):
        with pytest.raises(InputError, match=words):
            read_stress(text)


def test_light():
    grey = torch.full((1, 3, 8, 6), 100, dtype=torch.uint8)
    same = Light(Stress(), np.random.default_rng(0), 480)
    assert same.frame(grey, 240, 1.0) is grey
    dark = Light(Stress(dark=0.5), np.random.default_rng(0), 480)
    assert set(dark.frame(grey, 0, 0.3).unique().tolist()) == {50}
    noisy = Light(Stress(noise=0.05), np.random.default_rng(0), 480).frame(
        torch.full((1, 3, 80, 60), 100, dtype=torch.uint8), 0, 0.0
    )
    assert noisy.float().std() == pytest.approx(255 * 0.05, rel=0.05)
    light = Light(Stress(flicker=0.1, rolling=0.03), np.random.default_rng(0), 480)
    rows = light.gain(0.0, np.arange(480.0))
    assert rows.max() == pytest.approx(1.1, abs=1e-3)
    assert np.count_nonzero(np.diff(np.sign(rows - 1))) in (6, 7)  # three periods of 100 Hz in 30 ms
    swings = [float(Light(Stress(exposure=0.5), np.random.default_rng(0), 480).gain(t, rows)[0]) for t in (0.75, 2.25)]
    assert swings == pytest.approx([1.5, 0.5])


def test_axes_of_turned_cameras():
    level = axes(0.3, 0, Stress())
    assert level[0] == pytest.approx([math.cos(0.3), math.sin(0.3), 0])
    assert level[1] == pytest.approx([0, 0, 1])
    down, up = axes(0.0, 1, Stress(pitch=3))
    assert down == pytest.approx([math.cos(math.radians(3)), 0, -math.sin(math.radians(3))])
    assert up[0] == pytest.approx(math.sin(math.radians(3)))
    _, leaning = axes(0.0, 0, Stress(roll=2))
    assert leaning == pytest.approx([0, -math.sin(math.radians(2)), math.cos(math.radians(2))])
    assert [math.atan2(*axes(0.0, side, Stress(yaw=1, turned=2))[0][1::-1]) for side in (0, 1)] == pytest.approx(
        [math.radians(1), math.radians(3)]
    )


def test_rolling_shutter_reads_rows_in_turn():
    rect = Rect(300, 330, 0, 10)
    assert list(slices(rect, Stress(), 480)) == [(rect, 0.0)]
    parts = list(slices(rect, Stress(rolling=0.048), 480))
    assert [part.top for part, _ in parts] == [300, 312, 324]
    assert parts[-1][0].bottom == 330
    assert parts[0][1] == pytest.approx(0.048 * (306 / 480 - 0.5))
    assert moved(1.0, 2.0, 0.0, Motion(0.5, 0.0), -0.1) == pytest.approx((0.95, 2.0, 0.0))
    assert moved(0.0, 0.0, 0.0, Motion(1.0, math.pi), 1.0)[2] == pytest.approx(math.pi)


def frames(time):
    part = torch.tensor([[time]])
    return StereoFrames(Strips(part, part), Strips(part, part), time)


def shown(given):
    return round(float(given.left.field), 3), round(given.time, 3)


def test_timing():
    late = FrameTiming(Stress(late=0.1), np.random.default_rng(0))
    found = [shown(late.deliver(frames(k / 10))) for k in range(4)]
    assert found == [(0.0, -0.1), (0.0, 0.0), (0.1, 0.1), (0.2, 0.2)]
    again = FrameTiming(Stress(repeat=0.5), np.random.default_rng(0))
    pictures = [shown(again.deliver(frames(k / 10))) for k in range(200)]
    assert [time for _, time in pictures] == pytest.approx([k / 10 for k in range(200)])
    repeated = sum(a[0] == b[0] for a, b in itertools.pairwise(pictures))
    assert 70 < repeated < 130
    lost = FrameTiming(Stress(drop=0.3), np.random.default_rng(0))
    assert 40 < sum(lost.loses() for _ in range(200)) < 80
    assert not FrameTiming(Stress(), np.random.default_rng(0)).loses()


def test_delay_slack_and_odometer():
    delay = Delay(0.15)
    delay.put(DriveCommand(0.5, 0.0), 0.0)
    delay.put(DriveCommand(0.4, 0.0), 0.05)
    assert [delay.take(t) for t in (0.1, 0.15, 0.21)] == [None, DriveCommand(0.5, 0.0), DriveCommand(0.4, 0.0)]
    car = Car(slack=0.3)
    car.send(DriveCommand(0.5, 1.0))
    for _ in range(60):
        car.advance(1 / 60)
    assert car.curvature == pytest.approx(0.7)
    car.send(DriveCommand(0.5, 0.5))
    for _ in range(60):
        car.advance(1 / 60)
    assert car.curvature == pytest.approx(0.7)  # 0.5 is within the slack
    odometer = Odometer(Stress(scale=0.05, bend=0.1, slip=0.2), np.random.default_rng(0))
    said = [odometer.says(DriveCommand(1.0, 0.0), t) for t in (0.1, 0.5, 1.1)]
    assert said[0] == said[1] != said[2]
    assert all(1.05 <= s.speed <= 1.25 and s.curvature == pytest.approx(0.1) for s in said)


SMALL = Plan("small", ring([(0, 0), (2, 0), (2, 2), (0, 2)]))


@needs_gl
def test_a_world_under_stress():
    def looked(whole=False, **stress):
        simulation = Simulation(SMALL, 1, stress=Stress(**stress), whole=whole)
        try:
            simulation.place(0.6, 1.0, 0.1)
            simulation.obey(DriveCommand(0.5, 1.0))
            simulation.wait_until(0.2)
            return simulation.read(), simulation.pose, simulation.driven()
        finally:
            simulation.close()

    plain, pose, driven = looked()
    for name, stress in (("turned", {"turned": 1.0}), ("others", {"focal": 0.05, "blur": 0.05, "rolling": 0.05})):
        seen, same, said = looked(**stress, scale=0.1)
        assert same == pose
        assert said.speed == pytest.approx(1.1 * driven.speed)
        assert (seen.right.field.int() - plain.right.field.int()).abs().float().mean() > 1
        assert torch.equal(seen.left.row, plain.left.row) == (name == "turned")
    assert looked(delay=0.3)[1] == (0.6, 1.0, 0.1)
    # A camera that looks down by 3 degrees sees in the middle what lies 22 pixels lower for a level one.
    level, low = (looked(whole=True, **stress)[0].left[0, 1].float() for stress in ({}, {"pitch": 3}))

    def unlike(k):
        return float((low[200:280, 300:340] - level[200 + k : 280 + k, 300:340]).abs().mean())

    assert min(range(-30, 31), key=unlike) == pytest.approx(RIG.focal * math.tan(math.radians(3)), abs=1.5)
