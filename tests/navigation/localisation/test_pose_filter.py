"""What is known of the odometer grows with every match, and is right in the end."""

import math

import numpy as np
import pytest

from ndtorch.navigation.localisation.params import LocaliserParams
from ndtorch.navigation.localisation.pose_filter import predict, update

PARAMS = LocaliserParams()
SURE = np.array((1e5, 0.0, 1e5, 0.0, 0.0, 1e6))


def driven(pose, way, turned, seconds, scale, bend, drift):
    """The pose after a short step of an odometer whose errors are taken to be these."""
    x, y, heading = pose
    turn = turned - drift * seconds - bend * turned
    middle = heading + turn / 2
    return np.array(
        (x + (1 - scale) * way * math.cos(middle), y + (1 - scale) * way * math.sin(middle), heading + turn)
    )


def test_the_covariance_is_that_of_the_step():
    rng, way, turned, seconds = np.random.default_rng(2), 0.1, 0.05, 0.2
    root = rng.normal(size=(6, 6)) * (0.01, 0.01, 0.01, 0.02, 0.02, 0.002)
    covariance = root.T @ root
    start = np.array((1.0, 2.0, 0.4))
    jacobian = np.eye(6)
    for n, size in enumerate((1e-5,) * 6):
        change = np.zeros(6)
        change[n] = size
        ends = [driven(start + s * change[:3], way, turned, seconds, *(s * change[3:])) for s in (1, -1)]
        jacobian[:3, n] = (ends[0] - ends[1]) / (2 * size)
    unsure = np.array((1e-4, 1e-5))
    found = predict(covariance, way, turned, unsure, seconds, start[2] + turned, PARAMS)
    noise = predict(np.zeros((6, 6)), way, turned, unsure, seconds, start[2] + turned, PARAMS)
    assert noise == pytest.approx(np.diag(np.diag(noise)))
    assert found - noise == pytest.approx(jacobian @ covariance @ jacobian.T, rel=1e-3, abs=1e-9)


def test_it_learns_what_the_odometer_does():
    errors = np.array((0.015, -0.01, math.radians(0.03)))
    known, covariance = np.zeros(3), np.diag(np.square((0, 0, 0, 0.01, 0.01, math.radians(0.02))))
    true = pose = np.array((0.0, 0.0, 0.0))
    for n in range(400):
        way, turned = 0.1, 0.1 if n % 40 < 15 else 0.0
        true = driven(true, way, turned, 0.2, *errors)
        pose = driven(pose, way, turned, 0.2, *known)
        covariance = predict(covariance, way, turned, np.array((2.5e-5, 1e-5)), 0.2, pose[2], PARAMS)
        change, covariance = update(covariance, true - pose, SURE, PARAMS)
        pose, known = pose + change[:3], known + change[3:]
    assert pose == pytest.approx(true, abs=0.005)
    assert known == pytest.approx(errors, abs=0.004)
    assert np.linalg.eigvalsh(covariance).min() > 0


def test_a_fit_that_says_nothing_changes_nothing_and_a_slip_is_believed():
    covariance = np.diag(np.square((0.01, 0.01, 0.005, 0.01, 0.01, 0.001)))
    change, after = update(covariance, np.array((0.02, 0.0, 0.0)), np.zeros(6), PARAMS)
    assert np.abs(change).max() < 1e-4
    assert after == pytest.approx(covariance, rel=1e-3)
    change, _ = update(covariance, np.array((0.3, 0.0, 0.0)), SURE, PARAMS)
    assert change[0] > 0.2


def test_a_fit_changes_what_is_known_as_a_kalman_filter_does():
    rng, p = np.random.default_rng(3), PARAMS
    root = rng.normal(size=(6, 6)) * 0.02
    covariance, off = root.T @ root, np.array((0.004, -0.003, 0.002))
    information = np.array((4e4, 3e3, 5e4, -2e3, 1e3, 6e4))
    xx, xy, yy, xh, yh, hh = information
    said = np.array(((xx, xy, xh), (xy, yy, yh), (xh, yh, hh))) * p.information_scale + 1e-3 * np.eye(3)
    error = np.linalg.inv(said) + np.diag(np.square((p.min_sigma_m, p.min_sigma_m, p.min_sigma_rad)))
    seen = np.eye(3, 6)
    gain = covariance @ seen.T @ np.linalg.inv(seen @ covariance @ seen.T + error)
    change, after = update(covariance, off, information, PARAMS)
    assert change == pytest.approx(gain @ off)
    assert after == pytest.approx(covariance - gain @ seen @ covariance)
