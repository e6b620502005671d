"""Ranges from two rows of pixels: ND-min, features, correspondence, triangulation."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.grey import grey_row
from ndtorch.kernels.row_features import describe, match, strongest
from ndtorch.kernels.strips import Array, high_pass, larger
from ndtorch.kernels.triangulation import triangulate
from ndtorch.utils.jit import jit


@jit
def row_ranges(
    frames: tuple[Array, Array],
    beside: bool,
    top: int,
    unit: float,
    count: int,
    settle: bool,
    low: Array,
    a: float,
    new_low: Array,
    finding: tuple[int, int, float, float, int, int, tuple[int, int, int]],
    matching: tuple[float, float, bool, float],
    rig: tuple[float, float, float, float, bool],
    out: Array,
    valid: Array,
) -> float:
    """The step of `RowRanging` without prediction.

    Args:
        frames, beside, unit, count: of each eye, see `grey_row`; `top` is the number of their row.
        settle, a, low, new_low: see `high_pass`; `[2, W]`.
        finding: number of features, spacing, weakest motion, least difference, reach of edges, border without features,
            and what is kept for the middle, see `strongest`.
        matching: least and largest disparity, one to one, largest error.
        rig: column of the axes, factor to angles, baseline, forward, and whether angles are exact.
        out: range, left and right angle, x, y: `[5, n]`; `valid`: `[n]`.

    Returns:
        The largest magnitude of motion.
    """
    n, spacing, weakest, difference, reach, border, kept = finding
    width = low.shape[1]
    rows, motion = np.empty((2, width), low.dtype), np.empty(width, low.dtype)
    now, before, after = rows.reshape(-1), low.reshape(-1), new_low.reshape(-1)
    column, strength = np.empty((2, n), low.dtype), np.empty((2, n), low.dtype)
    patch, good = np.empty((2, n, 3), low.dtype), np.empty((2, n), np.bool_)
    most, whole = low.dtype.type(0), motion.view(np.int32)
    # Plain numbers in the call would be types of their own, and the function be compiled once more.
    left, every = np.intp(0), np.intp(1)
    for eye in range(2):
        grey_row(frames[eye], beside, top, left, every, unit, count, rows[eye])
        for x in range(width):
            motion[x] = 0
        high_pass(now, before, np.uintp(eye * width), settle, a, after, motion)
        for x in range(width):
            most = larger(motion[x], most)
        for x in range(border):
            motion[width - 1 - x if eye else x] = 0
        strongest(motion, whole, spacing, kept, column[eye], strength[eye])
        describe(rows[eye], column[eye], strength[eye], spacing, weakest, difference, reach, patch[eye], good[eye])
    match(column, patch, good, matching, out[0], valid)
    triangulate(column[0], rig, out, valid)
    return float(most)
