"""Where most pixels of a square around are marked."""

from __future__ import annotations

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def mark_most(image: Array, side: int, found: Array) -> None:
    """`ndtorch.vision.camera.figures.most_of` of an image of 1 and 0, `[h, w]` uint8, into `found`, likewise."""
    height, width = image.shape
    half = side // 2
    if side == 3:
        near = np.empty(width + 2, np.uint8)
        for y in range(height):
            add_three(image[inside(y - 1, height)], image[y], image[inside(y + 1, height)], near)
            near[0], near[width + 1] = near[1 + inside(-1, width)], near[1 + inside(width, width)]
            mark_five(near, found[y])
        return
    # Beyond its edges the image goes on mirrored at the middle of its outer pixels.
    line, sums = np.empty(width + side, np.int32), np.empty(width, np.int32)
    for y in range(height):
        for x in range(width):
            line[half + x] = sums[x] = 0
        for j in range(side):
            add_marks(image[inside(y - half + j, height)], line[half : half + width])
        for x in range(half):
            line[x] = line[half + inside(x - half, width)]
        for x in range(width, width + side - half):
            line[half + x] = line[half + inside(x, width)]
        for j in range(side):
            add_marks(line[j : j + width], sums)
        mark_large(sums, side * side, found[y])


@jit
def add_three(upper: Array, middle: Array, lower: Array, near: Array) -> None:
    """Sums of three rows of marks, from the second number on: bytes, for that takes a fourth of the time."""
    for x in range(middle.shape[0]):
        near[x + 1] = upper[x] + middle[x] + lower[x]


@jit
def mark_five(near: Array, found: Array) -> None:
    """Mark where three such sums are five or more of nine."""
    for x in range(found.shape[0]):
        found[x] = np.uint8(near[x] + near[x + 1] + near[x + 2]) >= np.uint8(5)


@jit
def add_marks(marks: Array, sums: Array) -> None:
    """Add whole numbers to others."""
    for x in range(sums.shape[0]):
        sums[x] += np.int32(marks[x])


@jit
def mark_large(sums: Array, most: int, found: Array) -> None:
    """Mark sums of half the most or more."""
    half = np.int32(most)
    for x in range(found.shape[0]):
        found[x] = np.uint8(np.int32(2) * sums[x] >= half)


@jit
def inside(at: int, size: int) -> int:
    """The row or column that is shown at that place, beyond the edges too."""
    while at < 0 or at >= size:
        at = -at if at < 0 else 2 * size - 2 - at
        if size == 1:
            return 0
    return at
