"""One picture of a camera in means of blocks, and the figures by which it is judged; see `robot.eye`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[Any]

BLOCK = 4
"""Pixels of a block."""

TAIL = 50
"""The range of the row leaves out one of so many block means at either end."""


@jit
def glance(
    row: Floats,
    field: Floats,
    scale: float,
    row_means: Floats,
    field_means: Floats,
    row_shape: Floats,
    field_shape: Floats,
) -> tuple[float, float, float, float, float, float, float, float]:
    """Means, shapes and figures of one picture.

    Args:
        row, field: `[W]` and `[h, w]`; times `scale` they are levels of 255.
        row_means, field_means: `[W / 4]` and `[h / 4, w / 4]`, filled.
        row_shape, field_shape: `[W / 4 - 2 lag]` and `[h / 4, w / 4 - 2 lag]`, filled; their width tells the lag.

    Returns:
        As in `robot.eye.Figures`.
    """
    width, columns = len(row), len(row_means)
    high, wide = field_means.shape
    share = scale / BLOCK
    for c in range(columns):
        x = BLOCK * c
        row_means[c] = (row[x] + row[x + 1] + row[x + 2] + row[x + 3]) * share
    share = scale / BLOCK**2
    sums = np.empty(wide * BLOCK, row.dtype)
    for r in range(high):
        for x in range(wide * BLOCK):
            y = BLOCK * r
            sums[x] = field[y, x] + field[y + 1, x] + field[y + 2, x] + field[y + 3, x]
        for c in range(wide):
            x = BLOCK * c
            field_means[r, c] = (sums[x] + sums[x + 1] + sums[x + 2] + sums[x + 3]) * share
    lag = (columns - len(row_shape)) // 2
    for c in range(len(row_shape)):
        row_shape[c] = row_means[c + lag] - (row_means[c] + row_means[c + 2 * lag]) / 2
    lag = (wide - field_shape.shape[1]) // 2
    for r in range(high):
        for c in range(field_shape.shape[1]):
            field_shape[r, c] = field_means[r, c + lag] - (field_means[r, c] + field_means[r, c + 2 * lag]) / 2

    level, floor, middle, total = 0.0, 0.0, 0.0, 0.0
    for c in range(columns):
        level += row_means[c]
    for r in range(high):
        for c in range(wide):
            floor += field_means[r, c]
    for x in range(width):
        total += row[x]
    for c in range(len(row_shape)):
        middle += row_shape[c]
    middle /= len(row_shape)
    row_spread, field_spread, rough, spread = 0.0, 0.0, 0.0, 0.0
    for c in range(len(row_shape)):
        row_spread += (row_shape[c] - middle) ** 2
    middle = 0.0
    for r in range(high):
        for c in range(field_shape.shape[1]):
            middle += field_shape[r, c]
    middle /= field_shape.size
    for r in range(high):
        for c in range(field_shape.shape[1]):
            field_spread += (field_shape[r, c] - middle) ** 2
    total /= width
    for x in range(width):
        spread += (row[x] - total) ** 2
    for x in range(width - 1):
        rough += (row[x + 1] - row[x]) ** 2
    step = row.dtype.type(0)
    for x in range(width - 2):
        step = max(step, abs(row[x + 2] - row[x]))

    # The lowest and the highest few means, in order.
    cut = columns // TAIL
    low, top = np.full(cut + 1, np.inf, row.dtype), np.full(cut + 1, -np.inf, row.dtype)
    for c in range(columns):
        value = row_means[c]
        if value < low[cut]:
            k = cut
            while k > 0 and low[k - 1] > value:
                low[k] = low[k - 1]
                k -= 1
            low[k] = value
        if value > top[cut]:
            k = cut
            while k > 0 and top[k - 1] < value:
                top[k] = top[k - 1]
                k -= 1
            top[k] = value
    return (
        level / columns,
        floor / field_means.size,
        math.sqrt(row_spread / len(row_shape)),
        math.sqrt(field_spread / field_shape.size),
        rough / max(1, width - 1) * scale * scale,
        math.sqrt(spread / width) * scale,
        float(top[cut] - low[cut]),
        float(step) * scale,
    )
