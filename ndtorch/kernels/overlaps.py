"""How many pixels of each region lie in some boxes."""

from __future__ import annotations

from math import ceil, floor

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def overlaps(labels: Array, boxes: Array, inside: Array) -> None:
    """Adds the pixels of each of R regions in each of K boxes.

    Args:
        labels: number of the region of every pixel from 1, 0 where none is, `[h, w]` int32.
        boxes: top, left, bottom and right of each, pixels, `[K, 4]` float64; what is partly inside counts.
        inside: `[K, R]`.
    """
    height, width = labels.shape
    for k in range(boxes.shape[0]):
        top, left = max(0, floor(boxes[k, 0])), max(0, floor(boxes[k, 1]))
        bottom, right = min(height, ceil(boxes[k, 2])), min(width, ceil(boxes[k, 3]))
        for y in range(top, bottom):
            for x in range(left, right):
                number = labels[y, x]
                if number > 0:
                    inside[k, number - 1] += 1
