"""The largest |ND-min| in each cell of a rectangle of both images."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch.kernels.inner import apart, inner
from ndtorch.kernels.strips import Array, as_whole, grey_rows, high_pass


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


@inner
def grey_maxima(grey: Array, settle: bool, low: Array, gain: float, a: float, new_low: Array, cells: Array) -> None:
    """`cell_maxima` of what is grey already, `[2, h, w]`."""
    _, height, width = low.shape
    _, bands, blocks = cells.shape
    tall, wide = height // bands, width // blocks
    # A band at a time: long loops, of numbers that stay in the cache.
    size, peak = np.empty(tall * width, low.dtype), np.empty(width, low.dtype)
    lit, one = np.empty((tall, width), low.dtype), low.dtype.type(1)
    bright = low.dtype.type(gain)
    sizes, peaks, largest = as_whole(size), as_whole(peak), as_whole(cells)
    for eye in range(2):
        for band in range(bands):
            start = band * tall
            before, after = low[eye, start : start + tall], new_low[eye, start : start + tall]
            if bright != one and not settle:
                for y in range(tall):
                    for x in range(width):
                        lit[y, x] = before[y, x] * bright
                before = lit
            now = grey[eye, start : start + tall]
            high_pass(now.reshape(-1), before.reshape(-1), settle, a, after.reshape(-1), size)
            for x in range(width):
                peaks[x] = sizes[x]
            for y in range(1, tall):
                raise_to(peaks, sizes, np.uintp(y * width))
            for block in range(blocks):
                largest[eye, band, block] = highest(peaks, np.uintp(block * wide), wide)


@apart
def raise_to(peaks: Array, sizes: Array, start: Any) -> None:
    """The larger of each of two numbers, from `start` on."""
    for x in range(peaks.shape[0]):
        peaks[x] = max(peaks[x], sizes[start + np.uintp(x)])


@apart
def highest(peaks: Array, start: Any, count: int) -> Any:
    """The largest of so many numbers."""
    most = peaks[start]
    for x in range(1, count):
        most = max(most, peaks[start + np.uintp(x)])
    return most
