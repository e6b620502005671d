"""What kernels do with the rows that navigation reads: grey, and the high-pass of ND-min."""

from __future__ import annotations

from typing import Any

import numba

from ndtorch.kernels.load import FAST

Array = Any
"""A NumPy array, or one row of it."""


@numba.njit(fastmath=FAST, error_model="numpy")
def grey_row(frame: Array, beside: bool, y: int, left: int, every: int, unit: float, count: int, grey: Array) -> None:
    """Every so many pixels of row `y` from column `left` on: sum of colors times `unit`, over `count`.

    Args:
        frame: `[C, H, W]`, or `[H, W, C]` where colors lie `beside` each other.
    """
    kind = grey.dtype.type
    unit, count = kind(unit), kind(count)
    if beside:
        for x in range(grey.shape[0]):
            total = kind(0)
            for c in range(frame.shape[2]):
                total += kind(frame[y, left + every * x, c])
            grey[x] = total * unit / count
        return
    # Loops with a known step become vector instructions.
    red, green, blue = (frame[0, y, left:], frame[frame.shape[0] // 2, y, left:], frame[frame.shape[0] - 1, y, left:])
    if frame.shape[0] == 3 and every == 1:
        for x in range(grey.shape[0]):
            grey[x] = (kind(red[x]) + kind(green[x]) + kind(blue[x])) * unit / count
    elif frame.shape[0] == 3 and every == 2:
        for x in range(grey.shape[0]):
            grey[x] = (kind(red[2 * x]) + kind(green[2 * x]) + kind(blue[2 * x])) * unit / count
    elif frame.shape[0] == 3:
        for x in range(grey.shape[0]):
            grey[x] = (kind(red[every * x]) + kind(green[every * x]) + kind(blue[every * x])) * unit / count
    else:
        for x in range(grey.shape[0]):
            grey[x] = kind(red[every * x]) * unit / count


@numba.njit(fastmath=FAST, error_model="numpy")
def high_pass(grey: Array, low: Array, settle: bool, a: float, after: Array, high: Array) -> None:
    """One step of `NDMin` of one row: new state into `after`, output into `high`. It starts at rest to `settle`."""
    kind = grey.dtype.type
    share, rest = kind(a), kind(1 - a)
    for x in range(grey.shape[0]):
        before = grey[x] if settle else low[x]
        # As `torch.lerp` rounds it: from the nearer end.
        mean = before + share * (grey[x] - before) if share < kind(0.5) else grey[x] - rest * (grey[x] - before)
        after[x] = mean
        high[x] = grey[x] - mean


@numba.njit(error_model="numpy")
def larger(one: float, other: float) -> float:
    """The larger of two; what is no number is larger than all."""
    return one if one > other or one != one else other
