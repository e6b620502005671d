"""A picture that turns the wrong way is that of a camera upside down."""

from itertools import pairwise

import numpy as np
import pytest

from ndtorch_robot.camera_monitor.image_quality import ImageStatistics, Snapshot
from ndtorch_robot.camera_monitor.limits import CameraLimits
from ndtorch_robot.camera_monitor.motion_check import FlowDirectionCheck, shifted_correlation

FOCAL, BLOCKS = 430.0, 160


def seen(heading, seed=1, noise=0.5, mirrored=False):
    """What a camera sees of a round wall, block by block, that looks to there, radians to the left."""
    random = np.random.default_rng(seed)
    wall = np.repeat(random.uniform(30, 220, 200), 5)
    columns = (np.arange(BLOCKS) - (BLOCKS - 1) / 2) * 4
    angles = np.arctan2(columns, FOCAL) - heading
    row = np.interp(angles * FOCAL / 4 + 500, np.arange(1000), wall)
    row = (row + np.random.default_rng(round(1e6 + 1e4 * heading)).normal(0, noise, BLOCKS)).astype(np.float32)
    row = row[::-1].copy() if mirrored else row
    return Snapshot(row, row[None], row, row[None], ImageStatistics(*[0.0] * 8))


def said_after(turn, mirrored, flat=False, most=12):
    """How many pieces of a turn it takes until it is said; None where it never is."""
    turning = FlowDirectionCheck(FOCAL, CameraLimits())
    eyes = [seen(n * turn, mirrored=mirrored) for n in range(most + 1)]
    if flat:
        eyes = [eye._replace(row=0 * eye.row + 99) for eye in eyes]
    for n, (before, now) in enumerate(pairwise(eyes), 1):
        if turning.compare(now, before, turn):
            return n
    return None


@pytest.mark.parametrize("turn", [0.08, -0.08, 0.25, -0.25])
def test_a_camera_upside_down_is_told_after_some_pieces_of_a_turn(turn):
    assert said_after(turn, mirrored=True) == 4
    assert said_after(turn, mirrored=False) is None


def test_who_sees_nothing_says_nothing():
    assert said_after(0.1, mirrored=True, flat=True) is None


@pytest.mark.parametrize("shift", [8.0, -8.0])
def test_a_row_fits_where_it_was_moved_to(shift):
    row = np.random.default_rng(1).uniform(30, 220, BLOCKS)
    moved = np.roll(row, round(shift * 1.3))
    assert shifted_correlation(moved, row, shift) > 0.95
    assert shifted_correlation(moved, row, -shift) < 0.5
    assert shifted_correlation(moved, row, shift / 2) < 0.5
