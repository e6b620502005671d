"""The largest |ND-min| in each cell of a rectangle of both images."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.strips import Array, grey_row, high_pass, larger


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
        cells: `[2, bands, blocks]`.
    """
    _, height, width = low.shape
    _, bands, blocks = cells.shape
    grey, high, peak = np.empty(width, low.dtype), np.empty(width, low.dtype), np.empty(width, low.dtype)
    tall, wide = height // bands, width // blocks
    for eye in range(2):
        for band in range(bands):
            for x in range(width):
                peak[x] = 0
            for y in range(band * tall, (band + 1) * tall):
                grey_row(frames[eye], beside, tops[eye] + y, lefts[eye], every, unit, count, grey)
                high_pass(grey, low[eye, y], settle, a, new_low[eye, y], high)
                for x in range(width):
                    peak[x] = larger(abs(high[x]), peak[x])
            for block in range(blocks):
                largest = peak[block * wide]
                for x in range(block * wide + 1, (block + 1) * wide):
                    largest = larger(peak[x], largest)
                cells[eye, band, block] = largest
