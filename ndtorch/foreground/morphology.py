"""Binary morphology with squares, compiled: dilation, opening, closing and majority filter."""

from __future__ import annotations

import numpy as np

from ndtorch.foreground.arrays import Array
from ndtorch.utils.jit import jit


@jit
def any_nonzero(row: Array) -> bool:
    """Whether a row of whole numbers has one that is not 0. Most rows have none and are skipped by this test."""
    some = np.int32(0)
    for x in range(row.shape[0]):
        some |= np.int32(row[x])
    return bool(some != 0)


@jit
def opening(marks: Array, side: int, shape: tuple[int, int], margin: int, room: tuple[Array, Array]) -> None:
    """`cv2.MORPH_OPEN` with a square.

    Args:
        marks: 1 or 0, of an image with margins of zeros, row after row `[n]` uint8; changed in place.
        side: of the square.
        shape: height and width of the image without margins.
        margin: pixels beyond each edge, at least `side`.
        room: two buffers of n numbers.
    """
    invert(marks, shape, margin)
    dilate(marks, side, shape, margin, room)
    invert(marks, shape, margin)
    dilate(marks, side, shape, margin, room)


@jit
def closing(marks: Array, side: int, shape: tuple[int, int], margin: int, room: tuple[Array, Array]) -> None:
    """`cv2.MORPH_CLOSE` with a square; the arguments are those of `opening`."""
    dilate(marks, side, shape, margin, room)
    invert(marks, shape, margin)
    dilate(marks, side, shape, margin, room)
    invert(marks, shape, margin)


@jit
def row_of(marks: Array, y: int, width: int, margin: int) -> Array:
    """One row of an image with margins, without them."""
    first = (y + margin) * (width + 2 * margin) + margin
    return marks[first : first + width]


@jit
def dilate(marks: Array, side: int, shape: tuple[int, int], margin: int, room: tuple[Array, Array]) -> None:
    """`cv2.dilate` with a square; the arguments are those of `opening`.

    The window grows by doubling, along rows and then along columns. Rows follow each other in memory, so each doubling
    is one loop over the whole image.
    """
    height, width = shape
    line = width + 2 * margin
    one, other = room
    copy(marks, one)
    for unit in (1, line):
        size = 1
        while size < side:
            step = min(size, side - size)
            union(one, one[unit * step :], other)
            one, other = other, one
            size += step
    half = side // 2
    for y in range(height):
        first = (y - half + margin) * line + margin - half
        copy(one[first : first + width], row_of(marks, y, width, margin))


@jit
def invert(marks: Array, shape: tuple[int, int], margin: int) -> None:
    """1 becomes 0 and 0 becomes 1, except in the margins."""
    height, width = shape
    for y in range(height):
        row = row_of(marks, y, width, margin)
        for x in range(width):
            row[x] ^= np.uint8(1)


@jit
def copy(marks: Array, to: Array) -> None:
    for n in range(to.shape[0]):
        to[n] = marks[n]


@jit
def union(one: Array, other: Array, found: Array) -> None:
    """Marks of either array; the other may be shorter."""
    end = other.shape[0]
    for n in range(end):
        found[n] = one[n] | other[n]
    for n in range(end, found.shape[0]):
        found[n] = one[n]


@jit
def majority_filter(image: Array, found: Array) -> None:
    """1 where at least five of the 3 x 3 pixels around are 1, `[h, w]` uint8; edges are mirrored."""
    height, width = image.shape
    near = np.empty(width + 2, np.uint8)
    for y in range(height):
        add_three(image[mirrored(y - 1, height)], image[y], image[mirrored(y + 1, height)], near)
        near[0], near[width + 1] = near[1 + mirrored(-1, width)], near[1 + mirrored(width, width)]
        mark_five(near, found[y])


@jit
def add_three(upper: Array, middle: Array, lower: Array, near: Array) -> None:
    """Sums of three rows in bytes, from the second place on."""
    for x in range(middle.shape[0]):
        near[x + 1] = upper[x] + middle[x] + lower[x]


@jit
def mark_five(near: Array, found: Array) -> None:
    for x in range(found.shape[0]):
        found[x] = np.uint8(near[x] + near[x + 1] + near[x + 2]) >= np.uint8(5)


@jit
def mirrored(at: int, size: int) -> int:
    """Index of the pixel shown at a place beyond the edges (`cv2.BORDER_REFLECT_101`)."""
    while at < 0 or at >= size:
        at = -at if at < 0 else 2 * size - 2 - at
        if size == 1:
            return 0
    return at
