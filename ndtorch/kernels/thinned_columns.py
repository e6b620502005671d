"""Columns of an image thinned as its rows are by `thin_rows`, with mirrored margins at both sides."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.utils.jit import jit


@jit
def thin_columns(rows: Array, margin: int, image: Array) -> None:
    """`thin_rows` of the columns: halved around the middles of pairs, and again as often as it takes.

    Args:
        rows: `[R, W]`.
        margin: mirrored columns at both sides.
        image: becomes `[R, (W + 2 margin) / block]`, block a power of two.
    """
    height, width = rows.shape
    length = width + 2 * margin
    times = 0
    while length >> times > image.shape[1]:
        times += 1
    # A closed line: before it stands its last number, and after it its first two.
    line, halves = np.empty(length + 3, rows.dtype), np.empty((max(times - 1, 1), length // 2 + 1), rows.dtype)
    for y in range(height):
        copy_row(rows[y], line[1 + margin :])
        for x in range(margin):
            line[1 + x] = rows[y, margin - x]
            line[1 + margin + width + x] = rows[y, width - 2 - x]
        line[0], line[length + 1], line[length + 2] = line[length], line[1], line[2]
        if times == 0:
            for x in range(length):
                image[y, x] = line[1 + x]
        elif times == 1:
            halve_pairs(line, 0, length // 2, image[y])
        else:
            # The middle of a block lies between its second quarter and its third: one pixel further on, at first.
            halve_pairs(line, 1, length // 2, halves[0])
            halves[0, length // 2] = halves[0, 0]
            for level in range(1, times - 1):
                halve_odd(halves[level - 1], length >> (level + 1), halves[level])
            halve_even(halves[times - 2], length >> times, image[y])


@jit
def copy_row(row: Array, line: Array) -> None:
    """Copy a row to where a line begins: a view of it, since with numbers of places added up it is no vector loop."""
    for x in range(row.shape[0]):
        line[x] = row[x]


@jit
def halve_pairs(line: Array, first: int, length: int, half: Array) -> None:
    """Half of the numbers of a line from `first` on: weights 1/4, 3/4, 3/4, 1/4 around the middles of pairs."""
    quarter, most = half.dtype.type(0.25), half.dtype.type(0.75)
    for c in range(length):
        x = 2 * c + first
        half[c] = quarter * (line[x] + line[x + 3]) + most * (line[x + 1] + line[x + 2])


@jit
def halve_odd(line: Array, length: int, half: Array) -> None:
    """Every second number of a closed line from the second on, smoothed with weights 1/2, 1, 1/2 beforehand."""
    share = half.dtype.type(0.5)
    for c in range(length):
        half[c] = line[2 * c + 1] + share * (line[2 * c] + line[2 * c + 2])
    half[length] = half[0]


@jit
def halve_even(line: Array, length: int, half: Array) -> None:
    """The same from the first number on."""
    share = half.dtype.type(0.5)
    half[0] = line[0] + share * (line[2 * length - 1] + line[1])
    for c in range(1, length):
        half[c] = line[2 * c] + share * (line[2 * c - 1] + line[2 * c + 1])
