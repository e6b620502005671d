"""What is in the path and nearer than the ranging looks: both horizon rows compared."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.kernels.near_rows import near_rows
from ndtorch.navigation.near_params import NearParams
from ndtorch.navigation.rig import StereoRig

Floats = npt.NDArray[np.float32]
Whole = npt.NDArray[np.int64]


class Near(NamedTuple):
    """What a near check has found, body frame, m: places where something is; none where nothing was seen there."""

    x: Floats
    y: Floats


def believed(near: Near, likeness: float, rig: StereoRig, params: NearParams) -> Near:
    """Near things without those that cannot be: on a floor that both eyes see unbroken.

    What stands in the middle of the path, as far away as the floor that is compared, hides some of it. A mismatch of
    two poles farther away does not. Much that agrees is believed all the same: below a sofa floor is seen.

    Args:
        near: what `near_things` has found.
        likeness: of the floor right ahead, see `floor_likeness`.
    """
    p, depth = params, near.x - rig.forward
    stands_there = (np.abs(near.y) <= p.middle) & (depth >= p.floor_from) & (depth <= p.floor_to)
    if likeness < p.unbroken or len(near.x) >= p.few:
        return near
    return Near(near.x[~stands_there], near.y[~stands_there])


NEIGHBORS = 4
"""Disparities this near to the best one do not count as elsewhere."""


class Compared(NamedTuple):
    """Two rows compared, for every column of the left one `[W]`.

    Attributes:
        best: the disparity at which it differs least, less the first one that was tried.
        back: the same of its partner, seen from the right.
        value: by how much it differs there.
        elsewhere: by how much at least at other disparities.
    """

    best: Whole
    back: Whole
    value: Floats
    elsewhere: Floats


def near_things(left: Floats, right: Floats, rig: StereoRig, params: NearParams, by_kernel: bool = False) -> Near:
    """Things in the path and near, from two rows `[W]` in 0..1.

    Every place of the left row with some texture is looked for in the whole right row (sum of absolute differences);
    a match counts that is unlike all others and is found from the right as well.
    """
    p, focal = params, rig.focal / 2
    left, right = pairs_of(left), pairs_of(right)
    width, size = len(left), 2 * params.half + 1
    low = max(2, math.floor(focal * rig.baseline / p.farthest))
    high = min(width - size - 1, math.ceil(focal * rig.baseline / p.nearest))
    first = max(1, low // 8)  # what is farther must be able to match where it is
    none = np.zeros(0, np.float32)
    if high <= low:
        return Near(none, none)
    compare = compared_by_kernel if by_kernel else compared
    best, back, value, elsewhere = compare(left, right, first, high, p.half)
    columns, disparity, mutual = np.arange(width), best + first, np.abs(back - best) <= 2
    steps = np.abs(np.diff(left, prepend=left[:1]))
    busy = np.convolve(steps, np.ones(size) / size, "same") >= p.texture
    depth = focal * rig.baseline / disparity
    aside = rig.baseline / 2 + depth * ((width - 1) / 2 - columns) / focal
    good = mutual & busy & (value < p.ratio * elsewhere) & (disparity >= low) & (np.abs(aside) <= p.beside)
    # Neighbors that agree: a mismatch seldom has any.
    found = np.flatnonzero(good)
    found = found[agreeing(np.where(good, depth, np.nan), found, p)]
    x, y = rig.forward + depth[found], aside[found]
    return Near(np.asarray(x, np.float32), np.asarray(y, np.float32))


def compared(left: Floats, right: Floats, first: int, high: int, half: int) -> Compared:
    """Two rows at the disparities from `first` up to `high`, windows of `half` columns to either side."""
    width, size, depth = len(left), 2 * half + 1, high - first
    cost = np.full((depth, width), 9.0, np.float32)
    for d in range(first, high):
        sums = np.cumsum(np.abs(left[d:] - right[: width - d]), dtype=np.float64)
        windows = np.concatenate((sums[size - 1 : size], sums[size:] - sums[:-size])) / size
        cost[d - first, d + half : d + half + len(windows)] = windows
    columns = np.arange(width)
    best = cost.argmin(0)
    # From the right: the best left partner of the column that was found.
    partner = np.clip(columns - best - first, 0, width - 1)
    places = np.arange(first, high)[:, None] + partner[None]
    from_right = np.where(places < width, cost[np.arange(depth)[:, None], np.minimum(places, width - 1)], 9.0)
    apart = np.abs(np.arange(depth)[:, None] - best[None]) > NEIGHBORS
    elsewhere = np.where(apart, cost, np.float32(9)).min(0)
    return Compared(best, from_right.argmin(0), cost[best, columns], elsewhere)


def compared_by_kernel(left: Floats, right: Floats, first: int, high: int, half: int) -> Compared:
    """The same, by a kernel."""
    best, back, costs = (
        np.empty(len(left), np.int64),
        np.empty(len(left), np.int64),
        np.empty((2, len(left)), np.float32),
    )
    near_rows(left, right, first, high, half, NEIGHBORS, best, back, costs)
    return Compared(best, back, *costs)


def pairs_of(row: Floats) -> Floats:
    """Means of two pixels each: a quarter of the work, and what is near is coarse."""
    row = row[: len(row) // 2 * 2]
    return np.asarray((row[::2] + row[1::2]) / 2, np.float32)


def agreeing(depths: npt.NDArray[np.float64], columns: Whole, params: NearParams) -> npt.NDArray[np.bool_]:
    """Whether enough places around each of these columns have its depth, within a tenth; NaN where there is none."""
    half = params.half
    beside = np.full(len(depths) + 2 * half, np.nan)  # `np.pad` takes ten times as long
    beside[half : half + len(depths)] = depths
    around = beside[columns[:, None] + np.arange(2 * half + 1)]
    own = depths[columns, None]
    return np.asarray((np.abs(around - own) < 0.1 * own).sum(1) >= params.enough)
