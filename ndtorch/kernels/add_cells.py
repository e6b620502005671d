"""Distributions of one frame summed up in the cells of another."""

from __future__ import annotations

import math
from typing import Any

import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[Any]


@jit
def add_cells(sums: Floats, packed: Floats, cos: float, sin: float, x: float, y: float, cell: float) -> None:
    """Add cells `[k, 8]` of `pack` to `sums` `[size, size, 6]` of `add_points` in place, each where its middle lies.

    Args:
        cos, sin, x, y: of the pose of their frame.
        cell: side of a cell, in both frames, m.
    """
    half = sums.shape[0] // 2
    for k in range(len(packed)):
        at = packed[k]
        w = at[2]
        mx, my = at[3] / w, at[4] / w
        xx, xy, yy = at[5] / w - mx * mx, at[6] / w - mx * my, at[7] / w - my * my
        lx, ly = (at[0] + 0.5) * cell + mx, (at[1] + 0.5) * cell + my
        gx, gy = x + cos * lx - sin * ly, y + sin * lx + cos * ly
        i, j = math.floor(gx / cell), math.floor(gy / cell)
        if not (-half <= i < half and -half <= j < half):
            continue
        dx, dy = gx - (i + 0.5) * cell, gy - (j + 0.5) * cell
        to = sums[i + half, j + half]
        to[0] += w
        to[1] += w * dx
        to[2] += w * dy
        to[3] += w * (dx * dx + cos * cos * xx - 2 * cos * sin * xy + sin * sin * yy)
        to[4] += w * (dx * dy + cos * sin * (xx - yy) + (cos * cos - sin * sin) * xy)
        to[5] += w * (dy * dy + sin * sin * xx + 2 * cos * sin * xy + cos * cos * yy)
