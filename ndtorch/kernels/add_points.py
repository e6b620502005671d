"""Points summed up in cells: how many there are, where their middle is, and how they are spread."""

from __future__ import annotations

import math
from typing import Any

import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[Any]


@jit
def add_points(sums: Floats, x: Floats, y: Floats, weight: Floats, cell: float, most: float) -> None:
    """Add points to `sums` `[size, size, 6]` in place: weight, and its sums over x, y, x x, x y, y y.

    Args:
        x, y, weight: of the points, `[n]`; places are counted from the middle of the first axes, and points outside
            are left out.
        cell: side of a cell, m.
        most: a cell that weighs more forgets so much that it weighs this.
    """
    size = sums.shape[0]
    half = size // 2
    for k in range(len(x)):
        i, j = math.floor(x[k] / cell), math.floor(y[k] / cell)
        if not (-half <= i < half and -half <= j < half):
            continue
        at = sums[i + half, j + half]
        dx, dy, w = x[k] - (i + 0.5) * cell, y[k] - (j + 0.5) * cell, weight[k]
        at[0] += w
        at[1] += w * dx
        at[2] += w * dy
        at[3] += w * dx * dx
        at[4] += w * dx * dy
        at[5] += w * dy * dy
        if at[0] > most:
            keep = most / at[0]
            for n in range(6):
                at[n] *= keep
