"""Marks of a picture made wider and narrower by a square, and what most of its neighbours say."""

from __future__ import annotations

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def opened(marks: Array, side: int, shape: tuple[int, int], margin: int, room: tuple[Array, Array]) -> None:
    """What is left of marks that a square of that side fits into, as `cv2.MORPH_OPEN`.

    Args:
        marks: 1 or 0, of a picture with margins of zeros, row after row `[n]` uint8; they become those left.
        side: of the square.
        shape: height and width of the picture, without margins.
        margin: pixels beyond each edge, at least as many as the side.
        room: for twice n numbers.
    """
    turned(marks, shape, margin)
    widened(marks, side, shape, margin, room)
    turned(marks, shape, margin)
    widened(marks, side, shape, margin, room)


@jit
def closed(marks: Array, side: int, shape: tuple[int, int], margin: int, room: tuple[Array, Array]) -> None:
    """Marks with the gaps filled into which no square of that side fits, as `cv2.MORPH_CLOSE`; see `opened`."""
    widened(marks, side, shape, margin, room)
    turned(marks, shape, margin)
    widened(marks, side, shape, margin, room)
    turned(marks, shape, margin)


@jit
def row_of(marks: Array, y: int, width: int, margin: int) -> Array:
    """One row of a picture with margins, without them."""
    first = (y + margin) * (width + 2 * margin) + margin
    return marks[first : first + width]


@jit
def turned(marks: Array, shape: tuple[int, int], margin: int) -> None:
    """1 becomes 0 and 0 becomes 1, but in the margins."""
    height, width = shape
    for y in range(height):
        turn(row_of(marks, y, width, margin))


@jit
def widened(marks: Array, side: int, shape: tuple[int, int], margin: int, room: tuple[Array, Array]) -> None:
    """Mark what has a mark in the square around it, as `cv2.dilate`; see `opened`.

    Windows of twice the size are joined of two, along rows and then along columns. As rows follow each other, each
    time is one loop over all of them.
    """
    height, width = shape
    line = width + 2 * margin
    one, other = room
    copied(marks, one)
    for unit in (1, line):
        size = 1
        while size < side:
            step = min(size, side - size)
            both(one, one[unit * step :], other)
            one, other = other, one
            size += step
    # A window begins half its side before.
    half = side // 2
    for y in range(height):
        first = (y - half + margin) * line + margin - half
        copied(one[first : first + width], row_of(marks, y, width, margin))


@jit
def turn(row: Array) -> None:
    """1 becomes 0 and 0 becomes 1."""
    for x in range(row.shape[0]):
        row[x] ^= np.uint8(1)


@jit
def copied(marks: Array, to: Array) -> None:
    """Copy marks."""
    for n in range(to.shape[0]):
        to[n] = marks[n]


@jit
def both(one: Array, other: Array, found: Array) -> None:
    """Marks of one or of the other; the other may be shorter."""
    end = other.shape[0]
    for n in range(end):
        found[n] = one[n] | other[n]
    for n in range(end, found.shape[0]):
        found[n] = one[n]
