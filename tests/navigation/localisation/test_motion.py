"""How a car moved is seen in the rows of a room drawn by ray casting, however wrong the wheels are."""

import math

import numpy as np
import pytest
import torch

from ndtorch.navigation import StereoRig
from ndtorch.navigation.localisation import LocaliserParams
from ndtorch.navigation.localisation.motion import Look, look_of, motion_seen
from ndtorch.navigation.localisation.scanning import scan_rows
from ndtorch.navigation.odometry import arc
from tests.navigation.localisation.test_localiser import CORNERS
from tests.navigation.planar_world import PlanarWorld

pytest.importorskip("numba")

PARAMS = LocaliserParams()
RIG = StereoRig(forward=0.15)


@pytest.fixture(scope="module")
def views():
    """Way and turn of some steps, and the rows before and after each of them, `[2, 2, W]`."""
    world = PlanarWorld(np.stack((CORNERS, np.roll(CORNERS, -1, 0)), 1), panels=(0.08, 0.5), seed=3)
    found = []
    for n, (way, turn) in enumerate([(0.1, 0.0), (0.1, 0.09), (0.08, -0.12), (0.12, 0.03), (-0.1, 0.0)] * 4):
        start = (-1.2 + 0.1 * n, -1.0, 0.2 * n)
        poses = [start, arc(*start, way, turn / way, 1.0)]
        # The cameras stand ahead of the point that the arc is driven by.
        eyes = [(x + RIG.forward * math.cos(h), y + RIG.forward * math.sin(h), h) for x, y, h in poses]
        left, right, _ = world.drive(eyes)
        found.append((way, turn, torch.from_numpy(np.stack((left, right), 1)).float()))
    return found


def errors(views, share):
    """Of way and turn `[n, 2]`, and their standard deviations, where the wheels count a share too much."""
    found = []
    for way, turn, rows in views:
        look = look_of(rows[0], scan_rows(rows[0], RIG, PARAMS))
        seen = motion_seen(look, rows[1], ((1 + share) * way, (1 + share) * turn), RIG, PARAMS.motion)
        if seen is not None:
            found.append((*(seen.mean - (way, turn)), *np.sqrt(np.diag(seen.doubt))))
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
    look = look_of(rows[0], scan_rows(rows[0], RIG, PARAMS))
    other = torch.from_numpy(rng.uniform(size=rows[1].shape)).float()
    assert motion_seen(look, other, (0.1, 0.0), RIG, PARAMS.motion) is None
    assert motion_seen(look, rows[1][:, :100], (0.1, 0.0), RIG, PARAMS.motion) is None
    assert motion_seen(Look(look.rows, look.points[:1]), rows[1], (0.1, 0.0), RIG, PARAMS.motion) is None


def test_what_the_kernel_says_of_a_motion(views, monkeypatch):
    """Its information becomes a covariance, and too few places, or such as do not fit, are no motion."""
    p, (_, _, rows) = PARAMS.motion, views[0]
    look = look_of(rows[0], scan_rows(rows[0], RIG, PARAMS))
    said = np.array([0.1, 0.02, 4e5, -2e5, 9e6, 20.0, 0.9 * p.worst, 20 / p.agree])

    class Told:
        def run(self, *given):
            given[-1][:] = said

    monkeypatch.setattr("ndtorch.navigation.localisation.motion.kernel", lambda name: Told())
    seen = motion_seen(look, rows[1], (0.1, 0.0), RIG, p)
    assert seen.mean.tolist() == [0.1, 0.02]
    wanted = np.linalg.inv([[4e5, -2e5], [-2e5, 9e6]]) + np.diag((p.floor**2, p.turn_floor**2))
    assert seen.doubt == pytest.approx(wanted, rel=1e-6)
    for place, limit, worse in ((5, 20.0, -0.1), (6, p.worst, 1e-6), (7, 20 / p.agree, 0.1)):
        kept, said[place] = said[place], limit
        assert motion_seen(look, rows[1], (0.1, 0.0), RIG, p) is not None
        said[place] = limit + worse
        assert motion_seen(look, rows[1], (0.1, 0.0), RIG, p) is None
        said[place] = kept
    said[5:] = p.least, 0.0, 0.0
    assert motion_seen(look, rows[1], (0.1, 0.0), RIG, p) is not None
    said[5] = p.least - 1
    assert motion_seen(look, rows[1], (0.1, 0.0), RIG, p) is None
