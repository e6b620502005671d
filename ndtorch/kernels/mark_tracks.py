"""Where objects are, and where the ground is not to be learned."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.any_of import any_of
from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def mark_tracks(silhouettes: Array, marks: Array, mask: Array, kept: Array) -> None:
    """See `ndtorch.binding.tracking.silhouettes.marked`.

    Args:
        silhouettes: number of the track of every pixel plus one, `[h, w]` int32.
        marks: whether it is an object, and whether the ground is kept under it, `[n, 2]` uint8.
        mask: becomes the first of every pixel, `[h, w]` uint8.
        kept: becomes 1 where the second is of a pixel or one beside it, 0 elsewhere, `[h, w]` float32.
    """
    height, width = silhouettes.shape
    wide = np.zeros((height + 2, width + 2), np.uint8)
    mask[:], some = 0, np.zeros(height + 2, np.bool_)
    for y in range(height):
        some[y + 1] = any_of(silhouettes[y])
        for x in range(width if some[y + 1] else 0):
            number = silhouettes[y, x]
            if number > 0:
                mask[y, x], wide[y + 1, x + 1] = marks[number, 0], marks[number, 1]
    line = np.empty(width + 2, np.uint8)
    for y in range(height):
        if not (some[y] or some[y + 1] or some[y + 2]):
            kept[y] = 0
            continue
        upper, middle, lower = wide[y], wide[y + 1], wide[y + 2]
        for x in range(width + 2):
            line[x] = upper[x] | middle[x] | lower[x]
        left, right = line[1 : width + 1], line[2 : width + 2]
        for x in range(width):
            kept[y, x] = line[x] | left[x] | right[x]
