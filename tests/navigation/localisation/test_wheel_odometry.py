"""How a car moved is seen in rows of a ray-cast room however wrong the wheels are; wheels are calibrated by that."""

import math

import numpy as np
import pytest

from ndtorch.navigation import StereoRig
from ndtorch.navigation.localisation.localiser import stereo_scan
from ndtorch.navigation.localisation.params import OdometryParams
from ndtorch.navigation.localisation.visual_odometry import Keyframe, Motion, estimate_motion, keyframe
from ndtorch.navigation.localisation.wheel_odometry import (
    calibrated_motion,
    calibrated_pose,
    fuse,
    is_calibrated,
    moved_to,
    predict,
    uncalibrated,
)
from ndtorch.navigation.odometry import Pose, arc
from tests.navigation.localisation.worlds import CORNERS
from tests.navigation.localisation.worlds import PARAMS as LOCALISER
from tests.navigation.planar_world import PlanarWorld

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


MIN_MATCHES = LOCALISER.odometry.min_matches
RIG = StereoRig(forward=0.15)


@pytest.fixture(scope="module")
def views():
    """Way and turn of some steps, and the rows before and after each of them, `[2, 2, W]`."""
    world = PlanarWorld(np.stack((CORNERS, np.roll(CORNERS, -1, 0)), 1), panels=(0.08, 0.5), seed=3)
    found = []
    for n, (way, turn) in enumerate([(0.1, 0.0), (0.1, 0.09), (0.08, -0.12), (0.12, 0.03), (-0.1, 0.0)] * 4):
        start = (-1.2 + 0.1 * n, -1.0, 0.2 * n)
        poses = [start, arc(Pose(*start), way, turn / way, 1.0)]
        # The cameras stand ahead of the point that the arc is driven by.
        eyes = [(x + RIG.forward * math.cos(h), y + RIG.forward * math.sin(h), h) for x, y, h in poses]
        left, right, _ = world.drive(eyes)
        found.append((way, turn, np.stack((left, right), 1).astype(np.float32)))
    return found


def errors(views, share, points=None):
    """Of way and turn `[n, 2]`, and their standard deviations, where the wheels count a share too much.

    `points`: as many of the points ranged, by default all.
    """
    found = []
    for way, turn, rows in views:
        before = keyframe(rows[0], stereo_scan(rows[0], RIG, LOCALISER))
        before = before._replace(points=before.points[:points])
        seen = estimate_motion(before, rows[1], ((1 + share) * way, (1 + share) * turn), RIG, MIN_MATCHES)
        if seen is not None:
            found.append((*(seen.mean - (way, turn)), *np.sqrt(np.diag(seen.covariance))))
    return np.array(found).reshape(-1, 2, 2)


@pytest.mark.parametrize("share", [0.0, 0.1, -0.3])
def test_way_and_turn_are_seen(views, share):
    found = errors(views, share)
    assert len(found) > 0.7 * len(views)
    assert np.median(np.abs(found[:, 0, 0])) < 0.003
    assert np.degrees(np.median(np.abs(found[:, 0, 1]))) < 0.05
    # Nearly all lie within three of the standard deviations that it gives.
    assert np.mean(np.abs(found[:, 0]) < 3 * found[:, 1]) > 0.9


@pytest.mark.parametrize("points", [1, 2])
def test_an_edge_or_two_show_the_turn(views, points):
    found = errors(views, 0.05, points)
    assert len(found) > 0.4 * len(views)
    assert np.mean(np.abs(found[:, 0]) < 3 * found[:, 1]) > 0.9
    assert np.degrees(np.median(np.abs(found[:, 0, 1]))) < 0.1


def test_other_rows_show_no_motion(views):
    rng = np.random.default_rng(0)
    _, _, rows = views[0]
    before = keyframe(rows[0], stereo_scan(rows[0], RIG, LOCALISER))
    other = rng.uniform(size=rows[1].shape).astype(np.float32)
    assert estimate_motion(before, other, (0.1, 0.0), RIG, MIN_MATCHES) is None
    assert estimate_motion(before, rows[1][:, :100], (0.1, 0.0), RIG, MIN_MATCHES) is None
    assert estimate_motion(Keyframe(before.rows, before.points[:0]), rows[1], (0.1, 0.0), RIG, MIN_MATCHES) is None
