"""Whether a near thing can be there: floor behind it is seen, or is not."""

import numpy as np
import pytest

from ndtorch.navigation import Navigator
from ndtorch.navigation.proximity.floor_consistency import reject_unoccluded
from ndtorch.navigation.proximity.params import ProximityParams
from ndtorch.navigation.proximity.stereo_match import Obstacles
from tests.navigation.proximity.test_check import DT, RIG, pair

RECTS = Navigator(RIG, DT).controller.fields


def fields(frames):
    return [
        eye[0, 0, r.top : r.bottom, r.left : r.right].numpy() / np.float32(255)
        for eye, r in zip(frames, RECTS, strict=True)
    ]


OPEN, SHUT = fields(pair(3.0)), fields(pair(0.9))


def left_of(depth, y, seen=OPEN, count=6):
    x = np.full(count, RIG.forward + depth, np.float32)
    near = Obstacles(x, (y + 0.002 * np.arange(count)).astype(np.float32))
    return len(reject_unoccluded(near, *seen, RECTS, RIG, ProximityParams()).x)


@pytest.mark.parametrize(("depth", "y"), [(0.35, 0.0), (0.45, -0.1), (0.45, 0.2), (0.88, -0.14)])
def test_what_would_hide_the_floor_that_is_seen_is_not_there(depth, y):
    assert left_of(depth, y) == 0
    assert left_of(depth, y, count=1) == 0
    assert left_of(depth, y, SHUT) == 6  # what stands there hides it
    assert left_of(depth, y, count=12) == 12  # what hangs hides none


def test_things_that_would_hide_little_of_the_floor_stay():
    assert left_of(0.7, 0.0) == 6
    assert left_of(0.88, 0.25) == 6
    assert left_of(0.35, 0.0, count=0) == 0


def test_one_thing_that_cannot_be_takes_no_other_with_it():
    x = RIG.forward + np.repeat(np.float32([0.45, 0.7]), 5)
    near = Obstacles(x, np.repeat(np.float32([0.0, 0.1]), 5))
    kept = reject_unoccluded(near, *OPEN, RECTS, RIG, ProximityParams())
    assert np.allclose(kept.x, RIG.forward + 0.7)


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_floor_is_compared_from_the_first_to_the_last_column_of_a_thing_and_no_further(mirrored):
    """Eleven places, 7 columns apart: floor of which the outer half is broken hides behind them, floor broken beside
    them does not."""
    depth, column = 0.45, 440 + 7 * np.arange(11)
    aside = RIG.baseline / 2 - (column - RIG.center[0]) * depth / RIG.focal
    near = Obstacles(np.full(11, RIG.forward + depth, np.float32), aside.astype(np.float32))
    for broken, kept in ((column < 475, 11), (np.zeros(11, bool), 0)):
        at = np.arange(RECTS[0].left, RECTS[0].right)
        outside = (at < column[0] - 10) | (at > column[-1] + 10)
        inside = np.isin(at, column[broken ^ mirrored][:, None] + np.arange(-9, 4)) if broken.any() else outside
        left, right = OPEN[0].copy(), OPEN[1]
        left[:, inside] = np.random.default_rng(0).uniform(0, 1, left[:, inside].shape)
        assert len(reject_unoccluded(near, left, right, RECTS, RIG, ProximityParams()).x) == kept
