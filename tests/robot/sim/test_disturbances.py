"""Disturbances of simulated drives: text to numbers, light, optics, timing, steering, odometer."""

import math

import numpy as np
import pytest
import torch

from ndtorch.navigation import Strips
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.sim.disturbances import Disturbances, Effects, read_disturbances
from ndtorch_robot.sim.plan import Plan, ring
from ndtorch_robot.sim.simulation import RIG, SimulatedCar, Simulation


def effects(**numbers):
    return Effects(Disturbances(**numbers), np.random.default_rng(0))


def test_light():
    grey = torch.full((1, 3, 80, 60), 100, dtype=torch.uint8)
    assert set(effects(darkness_ratio=0.5).image(grey, 0.3).unique().tolist()) == {50}
    assert effects(noise_sigma=0.05).image(grey, 0.0).float().std() == pytest.approx(255 * 0.05, rel=0.05)
    gain = np.array([Disturbances(flicker_ratio=0.1).light(t) for t in np.linspace(0, 0.03, 480)])
    assert gain.max() == pytest.approx(1.1, abs=1e-3)
    assert np.count_nonzero(np.diff(np.sign(gain - 1))) in (6, 7)  # three periods of 100 Hz in 30 ms
    swings = [Disturbances(exposure_ratio=0.5).light(t) for t in (0.75, 2.25)]
    assert swings == pytest.approx([1.5, 0.5])


def frames(time):
    part = torch.tensor([[time]])
    return StereoFrames(Strips(part, part), Strips(part, part), time)


def test_timing():
    def delivered(given):
        return round(float(given.left.field), 3), round(given.time, 3)

    late = effects(latency_s=0.1)
    assert [delivered(late.deliver(frames(k / 10))) for k in range(4)] == [(0, -0.1), (0, 0), (0.1, 0.1), (0.2, 0.2)]
    lost = effects(lost_ratio=0.3)
    assert 40 < sum(lost.loses_frame() for _ in range(200)) < 80
    assert not effects().loses_frame()


def test_delay_and_odometer():
    car = SimulatedCar(delay=0.15)
    car.send(DriveCommand(0.5, 0.0), 0.0)
    car.send(DriveCommand(0.4, 0.0), 0.05)
    wanted = []
    for time in (0.1, 0.15, 0.21):
        car.advance(0.01, time)
        wanted.append(car.wanted.speed)
    assert wanted == [0.0, 0.5, 0.4]
    odometer = effects(odometry_scale_ratio=0.05, curvature_bias_per_m=0.1, slip_ratio=0.2)
    measured = [odometer.odometry(DriveCommand(1.0, 0.0), t) for t in (0.1, 0.5, 1.1)]
    assert measured[0] == measured[1] != measured[2]
    assert all(1.05 <= s.speed <= 1.25 and s.curvature == pytest.approx(0.1) for s in measured)


def test_a_disturbed_world():
    def looked(text="", whole=False):
        small = Plan("small", ring([(0, 0), (2, 0), (2, 2), (0, 2)]))
        simulation = Simulation(small, 1, disturbances=read_disturbances(text), full_frames=whole)
        simulation.place(0.6, 1.0, 0.1)
        simulation.obey(DriveCommand(0.5, 1.0))
        simulation.wait_until(0.2)
        return simulation.read(), simulation.pose, simulation.driven()

    plain, pose, driven = looked()
    for text in ("right_yaw_deg=1", "focal_error_ratio=0.05"):
        disturbed, same, measured = looked(f"{text},odometry_scale_ratio=0.1")
        assert same == pose
        assert measured.speed == pytest.approx(1.1 * driven.speed)
        assert (disturbed.right.field.int() - plain.right.field.int()).abs().float().mean() > 1
        assert torch.equal(disturbed.left.row, plain.left.row) == text.startswith("right_yaw")
    assert looked("delay_s=0.3")[1] == (0.6, 1.0, 0.1)
    # A camera that looks down by 3 degrees sees in the middle what lies 22 pixels lower for a level one.
    level, low = (looked(text, whole=True)[0].left[0, 1].float() for text in ("", "pitch_deg=3"))

    def unlike(k):
        return float((low[200:280, 300:340] - level[200 + k : 280 + k, 300:340]).abs().mean())

    assert min(range(-30, 31), key=unlike) == pytest.approx(RIG.focal * math.tan(math.radians(3)), abs=1.5)
