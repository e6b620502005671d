"""How much brighter the light is than a frame before, see `navigation.controllers.ranging.light`."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.kernels.nth import nth_of
from ndtorch.kernels.strips import Array, grey_row


def light_gain(
    frames: tuple[Array, Array],
    beside: bool,
    tops: tuple[int, int],
    lefts: tuple[int, int],
    every: int,
    unit: float,
    count: int,
    low: Array,
    bands: int,
    blocks: int,
    limits: tuple[float, float, float],
) -> float:
    """The median over all cells of how much brighter their top rows are than in the state of the filters.

    Args:
        frames, beside, tops, lefts, every, unit, count, low: as of `cell_maxima`.
        limits: the smallest change that counts, the largest factor, and the mean that is dark.
    """
    _, height, width = low.shape
    tall, wide = height // bands, width // blocks
    kind = low.dtype.type
    dark = kind(limits[2]) * kind(wide)
    grey, ratios = np.empty(width, low.dtype), np.empty(2 * bands * blocks, low.dtype)
    for eye in range(2):
        for band in range(bands):
            y = band * tall
            grey_row(frames[eye], beside, tops[eye] + y, lefts[eye], every, unit, count, grey)
            before = low[eye, y]
            for block in range(blocks):
                now, was = kind(0), kind(0)
                for x in range(block * wide, (block + 1) * wide):
                    now += grey[x]
                    was += before[x]
                ratios[(eye * bands + band) * blocks + block] = max(now, dark) / max(was, dark)
    # What is no number has no place in an order; whoever asks finds it among the cells.
    total = kind(0)
    for k in range(ratios.shape[0]):
        total += ratios[k]
    if not math.isfinite(total):
        return 1.0
    gain: float = nth_of(ratios, ratios.shape[0], (ratios.shape[0] - 1) // 2)
    if abs(gain - 1) > limits[0] and 1 / limits[1] < gain < limits[1]:
        return gain
    return 1.0
