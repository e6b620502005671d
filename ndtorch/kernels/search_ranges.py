"""Ranges from a few rows of pixels: the search of the right ones, and triangulation."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.grey import grey_row
from ndtorch.kernels.search_row import Numbers, find_places
from ndtorch.kernels.strips import Array
from ndtorch.kernels.triangulation import triangulate
from ndtorch.utils.jit import jit


@jit
def search_ranges(
    frames: tuple[Array, Array],
    beside: bool,
    top: int,
    unit: float,
    count: int,
    around: int,
    params: Numbers,
    band: tuple[int, int],
    rig: tuple[float, float, float, float, bool],
    horizon: Array,
    out: Array,
    valid: Array,
) -> float:
    """The step of `RowRanging` that searches.

    Args:
        frames, beside, unit, count: of each eye, see `grey_row`; `top` is the number of their first row.
        around: how many rows.
        params, band: see `find_places`.
        rig: see `triangulate`.
        horizon: the middle rows, `[2, W]`, to be filled.
        out: range, left and right angle, x, y: `[5, n]`; `valid`: `[n]`.

    Returns:
        The largest magnitude of a pixel; what is no number is larger than all.
    """
    width, n = horizon.shape[1], out.shape[1]
    rows, most = np.empty((2, around, width), np.float32), np.float32(0)
    grey = np.empty(width, horizon.dtype)
    for eye in range(2):
        for r in range(around):
            grey_row(frames[eye], beside, top + r, 0, 1, unit, count, grey)
            for x in range(width):
                size = np.float32(abs(grey[x]))
                most = most if most >= size or most != most else size
                rows[eye, r, x] = grey[x]
            if r == around // 2:
                for x in range(width):
                    horizon[eye, x] = grey[x]
    found = np.empty((3, n), np.float32)
    find_places(rows[0], rows[1], params, band, found)
    column = np.empty(n, out.dtype)
    for i in range(n):
        column[i], out[0, i], valid[i] = found[0, i], found[1, i], found[0, i] > 0
    triangulate(column, rig, out, valid)
    return float(most)
