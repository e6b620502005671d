"""Where most pixels of a square around are marked."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.inner import apart, inner


@inner
def mark_most(image: Array, side: int, found: Array) -> None:
    """`ndtorch.vision.camera.figures.most_of` of an image of 1 and 0, `[h, w]` uint8, into `found`, likewise."""
    height, width = image.shape
    half = side // 2
    # Beyond its edges the image goes on mirrored at the middle of its outer pixels.
    line, sums = np.empty(width + side, np.int32), np.empty(width, np.int32)
    for y in range(height):
        line[:] = 0
        for j in range(side):
            add_marks(image[inside(y - half + j, height)], line[half : half + width])
        for x in range(half):
            line[x] = line[half + inside(x - half, width)]
        for x in range(width, width + side - half):
            line[half + x] = line[half + inside(x, width)]
        sums[:] = 0
        for j in range(side):
            add_marks(line[j : j + width], sums)
        mark_large(sums, side * side, found[y])


@apart
def add_marks(marks: Array, sums: Array) -> None:
    """Add whole numbers to others."""
    for x in range(sums.shape[0]):
        sums[x] += np.int32(marks[x])


@apart
def mark_large(sums: Array, most: int, found: Array) -> None:
    """Mark sums of half the most or more."""
    half = np.int32(most)
    for x in range(found.shape[0]):
        found[x] = np.uint8(np.int32(2) * sums[x] >= half)


@inner
def inside(at: int, size: int) -> int:
    """The row or column that is shown at that place, beyond the edges too."""
    while at < 0 or at >= size:
        at = -at if at < 0 else 2 * size - 2 - at
        if size == 1:
            return 0
    return at
