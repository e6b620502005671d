"""How much brighter the light is than a frame before, see `navigation.controllers.ranging.light`."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.kernels.grey import grey_row
from ndtorch.kernels.strips import Array
from ndtorch.utils.jit import jit
from ndtorch.utils.selection import quickselect


@jit
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
    tall = low.shape[1] // bands
    grey = np.empty((2, bands, low.shape[2]), low.dtype)
    for eye in range(2):
        for band in range(bands):
            grey_row(frames[eye], beside, tops[eye] + band * tall, lefts[eye], every, unit, count, grey[eye, band])
    return grey_gain(grey, 1, low, blocks, limits)


@jit
def grey_gain(grey: Array, step: int, low: Array, blocks: int, limits: tuple[float, float, float]) -> float:
    """`light_gain` of what is grey already: every so many rows are the top rows of the bands."""
    bands = grey.shape[1] // step
    tall, wide = low.shape[1] // bands, low.shape[2] // blocks
    kind = low.dtype.type
    dark = kind(limits[2]) * kind(wide)
    ratios = np.empty(2 * bands * blocks, low.dtype)
    for eye in range(2):
        for band in range(bands):
            line, before = grey[eye, step * band], low[eye, tall * band]
            for block in range(blocks):
                now, was = kind(0), kind(0)
                for x in range(block * wide, (block + 1) * wide):
                    now += line[x]
                    was += before[x]
                ratios[(eye * bands + band) * blocks + block] = max(now, dark) / max(was, dark)
    # What is no number has no place in an order; whoever asks finds it among the cells.
    total = kind(0)
    for k in range(ratios.shape[0]):
        total += ratios[k]
    if not math.isfinite(total):
        return 1.0
    gain: float = quickselect(ratios, ratios.shape[0], (ratios.shape[0] - 1) // 2)
    if abs(gain - 1) > limits[0] and 1 / limits[1] < gain < limits[1]:
        return gain
    return 1.0
