"""What is in some boxes of a picture, at one size, and how far that is from what was seen before."""

from __future__ import annotations

from math import ceil, floor

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def look_at(picture: Array, ground: Array, boxes: Array, before: Array, looks: Array, apart: Array) -> None:
    """`ndtorch.binding.tracking.whole.patch_of` each box.

    Args:
        picture, ground: `[3, h, w]`.
        boxes: top, left, bottom and right of each, pixels, `[K, 4]` int64.
        before: what was seen before, `[3, P, P]`.
        looks: become the difference of picture and ground in each box, `[K, 3, P, P]`.
        apart: becomes the mean squared difference of that and what was seen before, `[K]` float64.
    """
    _, height, width = picture.shape
    side = before.shape[1]
    line = np.empty(side, np.float64)
    for k in range(boxes.shape[0]):
        top, left = min(max(boxes[k, 0], 0), height - 1), min(max(boxes[k, 1], 0), width - 1)
        bottom, right = min(max(boxes[k, 2], top + 1), height), min(max(boxes[k, 3], left + 1), width)
        tall, wide = bottom - top, right - left
        shrinks = min(tall, wide) > side
        rows, columns = weights_of(tall, side, shrinks), weights_of(wide, side, shrinks)
        total = 0.0
        for c in range(3):
            look = looks[k, c]
            look[:] = 0
            for y in range(tall):
                here, there = picture[c, top + y, left:right], ground[c, top + y, left:right]
                for i in range(side):
                    line[i] = 0
                    for x in range(np.uint64(columns[i, wide]), np.uint64(columns[i, wide + 1])):
                        line[i] += columns[i, x] * (here[x] - there[x])
                for j in range(side):
                    if rows[j, y] > 0:
                        for i in range(side):
                            look[j, i] += rows[j, y] * line[i]
            for j in range(side):
                for i in range(side):
                    total += (look[j, i] - before[c, j, i]) ** 2
        apart[k] = total / (3 * side * side)


@jit
def weights_of(size: int, side: int, shrinks: bool) -> Array:
    """What each of `size` pixels counts for in each of `side` new ones, as OpenCV's INTER_AREA has it where it shrinks
    and INTER_LINEAR otherwise, `[side, size + 2]`; in the end the first that counts, and the one after the last."""
    weights, scale = np.zeros((side, size + 2)), size / side
    for n in range(side):
        if shrinks:
            start, end = n * scale, min((n + 1) * scale, float(size))
            first, last = floor(start), ceil(end - 1e-9)
            for k in range(first, last):
                weights[n, k] = max(0.0, min(end, k + 1.0) - max(start, float(k))) / (end - start)
        else:
            at = (n + 0.5) * scale - 0.5
            first = min(max(floor(at), 0), size - 1)
            share = at - first if 0 <= at < size - 1 else 0.0
            weights[n, first] = 1 - share
            last = first + 1
            if share > 0:
                weights[n, last] = share
                last += 1
        weights[n, size], weights[n, size + 1] = first, last
    return weights
