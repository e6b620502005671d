"""Where objects are, and where the ground is not to be learned."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array


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
    for y in range(height):
        for x in range(width):
            number = silhouettes[y, x]
            mask[y, x] = 0
            if number > 0:
                mask[y, x], wide[y + 1, x + 1] = marks[number, 0], marks[number, 1]
    line = np.empty(width + 2, np.uint8)
    for y in range(height):
        upper, middle, lower = wide[y], wide[y + 1], wide[y + 2]
        for x in range(width + 2):
            line[x] = upper[x] | middle[x] | lower[x]
        left, right = line[1 : width + 1], line[2 : width + 2]
        for x in range(width):
            kept[y, x] = line[x] | left[x] | right[x]
