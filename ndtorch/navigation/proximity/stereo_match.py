"""Obstacles in the path that are nearer than the ranging sees, by matching of both horizon rows."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.navigation.proximity._kernels import Floats, Indices, match_rows
from ndtorch.navigation.proximity.params import ProximityParams
from ndtorch.navigation.stereo.rig import StereoRig

PATCH_HALF = 6
"""Columns of a shrunk row that are compared to either side of a place."""

FOCAL, MIN_FOCAL = 215.0, 160.0
"""Focal length of shrunk rows, pixels: what is near is coarse. Rows of a shorter one than the second are not shrunk."""

UNIQUENESS_RATIO = 0.7
"""A match must differ by less than this share of the best one elsewhere."""

MIN_TEXTURE = 0.003
"""Mean step of brightness from column to column around a place, at least."""

MIDDLE_M = 0.1
"""An obstacle within this distance of the car's middle interrupts the floor that is compared."""


class Obstacles(NamedTuple):
    """Places of obstacles in the body frame, m, `[n]` each."""

    x: Floats
    y: Floats


class ProximityScan(NamedTuple):
    """What a proximity check finds, in the body frame.

    Attributes:
        obstacles: that are near.
        floor_seen: whether floor is seen right ahead.
        across: a line across the path: an obstacle is assumed there where no floor is seen.
        mismatches: places of ranges behind which floor is seen.
    """

    obstacles: Obstacles
    floor_seen: bool
    across: Obstacles
    mismatches: Obstacles


NOWHERE = Obstacles(np.zeros(0, np.float32), np.zeros(0, np.float32))


def reject_mismatches(obstacles: Obstacles, correlation: float, rig: StereoRig, params: ProximityParams) -> Obstacles:
    """Obstacles without those contradicted by an unbroken floor.

    An obstacle in the middle of the path, at a depth at which the floor is compared, hides some of it; a mismatch of
    two farther poles does not. Many places that agree are kept: the floor is seen below a sofa.

    Args:
        correlation: of the floor ahead, see `floor_correlation`.
    """
    p, depth = params, obstacles.x - rig.forward
    if correlation < p.unbroken_correlation or len(obstacles.x) >= p.mismatch_max_places:
        return obstacles
    on_floor = (np.abs(obstacles.y) <= MIDDLE_M) & (depth >= p.floor_min_depth_m) & (depth <= p.floor_max_depth_m)
    return Obstacles(obstacles.x[~on_floor], obstacles.y[~on_floor])


def detect_obstacles(left: Floats, right: Floats, rig: StereoRig, params: ProximityParams) -> Obstacles:
    """Near obstacles in the path from two rows `[W]` in 0..1.

    Every textured place of the left row is matched with the whole right row (sum of absolute differences). A match
    counts if it is unique, is found from the right as well, and has neighbours of the same depth.
    """
    p, fold = params, 1 if rig.focal < MIN_FOCAL else max(2, round(rig.focal / FOCAL))
    focal = rig.focal / fold / math.cos(rig.pitch)
    left, right = shrunk(left, fold), shrunk(right, fold)
    width, size = len(left), 2 * PATCH_HALF + 1
    low = max(2, math.floor(focal * rig.baseline / p.max_depth_m))
    high = min(width - size - 1, math.ceil(focal * rig.baseline / p.min_depth_m))
    first = max(1, math.floor(focal * rig.baseline / p.far_m))
    if high <= low:
        return NOWHERE
    best, back, cost, elsewhere = match_rows(left, right, first, high, PATCH_HALF)
    columns, disparity, mutual = np.arange(width), best + first, np.abs(back - best) <= 2
    steps = np.abs(np.diff(left, prepend=left[:1]))
    textured = np.convolve(steps, np.ones(size) / size, "same") >= MIN_TEXTURE
    depth = focal * rig.baseline / disparity
    aside = rig.baseline / 2 + depth * ((rig.center[0] - (fold - 1) / 2) / fold - columns) / focal
    unique = cost < UNIQUENESS_RATIO * elsewhere
    good = mutual & textured & unique & (disparity >= low) & (np.abs(aside) <= p.half_width_m)
    found = np.flatnonzero(good)
    found = found[has_support(np.where(good, depth, np.nan), found, p.min_support)]
    x, y = rig.forward + depth[found], aside[found]
    return Obstacles(np.asarray(x, np.float32), np.asarray(y, np.float32))


def shrunk(row: Floats, fold: int) -> Floats:
    """Means of so many pixels each."""
    row = row[: len(row) // fold * fold]
    return np.asarray(sum(row[k::fold] for k in range(fold)) / fold, np.float32)


def has_support(depths: npt.NDArray[np.float64], columns: Indices, least: int) -> npt.NDArray[np.bool_]:
    """Whether enough columns around each of these have its depth within a tenth; NaN is no depth."""
    half = PATCH_HALF
    padded = np.full(len(depths) + 2 * half, np.nan)
    padded[half : half + len(depths)] = depths
    around = padded[columns[:, None] + np.arange(2 * half + 1)]
    own = depths[columns, None]
    return np.asarray((np.abs(around - own) < 0.1 * own).sum(1) >= least)
