"""The largest |ND-min| in each cell of a rectangle of both images."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch.kernels.strips import Array, grey_rows, high_pass, larger
from ndtorch.utils.jit import jit


@jit
def cell_maxima(
    frames: tuple[Array, Array],
    beside: bool,
    tops: tuple[int, int],
    lefts: tuple[int, int],
    every: int,
    unit: float,
    count: int,
    settle: bool,
    low: Array,
    gain: float,
    a: float,
    new_low: Array,
    cells: Array,
) -> None:
    """`NDMin` and the maxima over cells of equal size, top row and leftmost column first.

    Args:
        frames, beside, unit, count: of each eye, see `grey_row`.
        tops, lefts: where the rectangles begin in them.
        every: take only every so many columns.
        settle, a: see `high_pass`.
        low, new_low: states `[2, h, w]`.
        gain: how much brighter the light is than in the state, 1 where that is not asked.
        cells: `[2, bands, blocks]`.
    """
    grey = np.empty(low.shape, low.dtype)
    grey_rows(frames, beside, tops, lefts, every, unit, count, grey)
    grey_maxima(grey, settle, low, gain, a, new_low, cells)


@jit
def grey_maxima(grey: Array, settle: bool, low: Array, gain: float, a: float, new_low: Array, cells: Array) -> None:
    """`cell_maxima` of what is grey already, `[2, h, w]`."""
    _, height, width = low.shape
    _, bands, blocks = cells.shape
    tall, wide = height // bands, width // blocks
    peaks = np.empty(width, low.dtype)
    now, before, after = grey.reshape(-1), low.reshape(-1), new_low.reshape(-1)
    bright = low.dtype.type(gain)
    if bright != low.dtype.type(1) and not settle:
        lit = np.empty(before.size, low.dtype)
        for k in range(before.size):
            lit[k] = before[k] * bright
        before = lit
    for eye in range(2):
        for band in range(bands):
            for x in range(width):
                peaks[x] = 0
            for y in range(tall):
                start = np.uintp(((eye * bands + band) * tall + y) * width)
                high_pass(now, before, start, settle, a, after, peaks)
            for block in range(blocks):
                cells[eye, band, block] = highest(peaks, np.uintp(block * wide), wide)


@jit
def highest(peaks: Array, start: Any, count: int) -> Any:
    """The largest of so many numbers."""
    most = peaks[start]
    for x in range(1, count):
        most = larger(peaks[start + np.uintp(x)], most)
    return most
