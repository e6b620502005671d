"""Wheels are calibrated by visual odometry, their slip is detected, and without it they are used as calibrated."""

import math

import numpy as np
import pytest

from ndtorch.navigation.localisation.params import OdometryParams
from ndtorch.navigation.localisation.visual_odometry import Motion
from ndtorch.navigation.localisation.wheel_odometry import (
    calibrated_motion,
    calibrated_pose,
    fuse,
    is_calibrated,
    moved_to,
    predict,
    uncalibrated,
)

PARAMS = OdometryParams()
SURE = np.diag(np.square((0.001, 0.0002)))
DT = 0.2


def roll(wheels, way, turn):
    """After they have said so much in one step."""
    x, y, heading = map(float, wheels.reported)
    middle = heading + turn / 2
    return predict(wheels, np.array((x + way * math.cos(middle), y + way * math.sin(middle), heading + turn)), DT)


def taught(steps=150, share=0.08, bend=0.02, drift=0.003):
    """Wheels that were seen to count too much."""
    wheels = uncalibrated(np.array((0.0, 0.0, 0.0)), PARAMS)
    for n in range(steps):
        way, turn = 0.1, 0.08 if n % 20 < 8 else 0.0
        wheels = roll(wheels, way / (1 - share), turn / (1 - share) / (1 - bend) + drift * DT)
        wheels, driven = fuse(wheels, Motion(np.array((way, turn)), SURE), PARAMS)
        assert driven.mean == pytest.approx((way, turn), abs=0.003)
    return wheels


def test_their_errors_are_learned():
    wheels = taught()
    assert wheels.errors.tolist() == pytest.approx((0.08, 0.02, 0.003), abs=0.004)
    assert calibrated_motion(roll(wheels, 0.1 / 0.92, 0.0)) == pytest.approx((0.1, -0.0005), abs=0.0005)


def test_only_what_is_seen_tells_their_errors():
    blind = uncalibrated(np.array((0.0, 0.0, 0.0)), PARAMS)
    assert not is_calibrated(blind, PARAMS)
    for _ in range(50):
        blind, _ = fuse(roll(blind, 0.1, 0.05), None, PARAMS)
    assert not is_calibrated(blind, PARAMS)
    seen = taught(20)
    assert is_calibrated(seen, PARAMS)
    for _ in range(50):
        seen, _ = fuse(roll(seen, 0.1, 0.05), None, PARAMS)
    assert is_calibrated(seen, PARAMS)


def test_where_nothing_is_seen_they_are_corrected_and_less_is_known():
    before = taught()
    wheels = roll(before, 0.1, 0.05)
    guess, place = calibrated_motion(wheels), calibrated_pose(wheels)
    after, driven = fuse(wheels, None, PARAMS)
    assert driven.mean == pytest.approx(guess)
    assert place == pytest.approx(after.base)
    assert after.errors.tolist() == before.errors.tolist()
    _, seen = fuse(wheels, Motion(driven.mean, SURE), PARAMS)
    assert (np.diag(seen.covariance) < 0.5 * np.diag(driven.covariance)).all()


def test_a_slip_is_seen_and_not_learned():
    before = taught()
    wheels = roll(before, 0.14, 0.035)
    after, driven = fuse(wheels, Motion(np.array((0.09, 0.0)), SURE), PARAMS)
    assert driven.mean == pytest.approx((0.09, 0.0), abs=0.002)
    assert after.errors.tolist() == pytest.approx(before.errors.tolist(), abs=0.03)
    assert after.since.tolist() == [0, 0, 0]


def test_a_car_that_stands_or_was_carried_has_driven_nothing():
    wheels = taught(20)
    still, driven = fuse(roll(wheels, 0.0, 0.0), None, PARAMS)
    assert driven.mean.tolist() == [0, 0]
    assert np.array_equal(still.covariance, wheels.covariance)
    put = moved_to(roll(wheels, 0.1, 0.1), np.array((1.0, 2.0, 3.0)))
    assert calibrated_pose(put).tolist() == [1.0, 2.0, 3.0]
    assert np.array_equal(put.errors, wheels.errors)
    assert put.keyframe is None
