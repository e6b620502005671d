"""How a car moved is seen in the rows of a room drawn by ray casting, however wrong the wheels are."""

import math

import numpy as np
import pytest

from ndtorch.navigation import StereoRig
from ndtorch.navigation.localisation.localiser import stereo_scan
from ndtorch.navigation.localisation.visual_odometry import Keyframe, estimate_motion, keyframe
from ndtorch.navigation.odometry import Pose, arc
from tests.navigation.localisation.worlds import CORNERS, PARAMS
from tests.navigation.planar_world import PlanarWorld

pytest.importorskip("numba")

MIN_MATCHES = PARAMS.odometry.min_matches
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


def errors(views, share):
    """Of way and turn `[n, 2]`, and their standard deviations, where the wheels count a share too much."""
    found = []
    for way, turn, rows in views:
        before = keyframe(rows[0], stereo_scan(rows[0], RIG, PARAMS))
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


def test_other_rows_show_no_motion(views):
    rng = np.random.default_rng(0)
    _, _, rows = views[0]
    before = keyframe(rows[0], stereo_scan(rows[0], RIG, PARAMS))
    other = rng.uniform(size=rows[1].shape).astype(np.float32)
    assert estimate_motion(before, other, (0.1, 0.0), RIG, MIN_MATCHES) is None
    assert estimate_motion(before, rows[1][:, :100], (0.1, 0.0), RIG, MIN_MATCHES) is None
    assert estimate_motion(Keyframe(before.rows, before.points[:1]), rows[1], (0.1, 0.0), RIG, MIN_MATCHES) is None
