"""Columns of an image thinned as its rows are by `thin_rows`, with mirrored margins at both sides."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.inner import inner


@inner
def thin_columns(rows: Array, margin: int, image: Array) -> None:
    """`thin_rows` of the columns: pairs first, then every second of those, smoothed, as often as it takes.

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
    # The first number of a closed line follows the last one once more.
    padded, lines = np.empty(length + 1, rows.dtype), np.empty((times + 1, length + 1), rows.dtype)
    for y in range(height):
        row = rows[y]
        for x in range(width):
            padded[margin + x] = row[x]
        for x in range(margin):
            padded[x] = row[margin - x]
            padded[margin + width + x] = row[width - 2 - x]
        if times:
            padded[length] = padded[0]
            pair_up(padded, length, lines[0])
            for level in range(times - 1):
                halve_odd(lines[level], length >> (level + 1), lines[level + 1])
            halve_even(lines[times - 1], length >> times, image[y])
        else:
            for x in range(length):
                image[y, x] = padded[x]


@inner
def pair_up(line: Array, length: int, pairs: Array) -> None:
    """Means of neighbors in a closed line: they lie between two pixels, where the middle of a block is."""
    half = pairs.dtype.type(0.5)
    for x in range(length):
        pairs[x] = half * (line[x] + line[x + 1])
    pairs[length] = pairs[0]


@inner
def halve_odd(line: Array, length: int, half: Array) -> None:
    """Every second number of a closed line from the second on, smoothed with weights 1/2, 1, 1/2 beforehand."""
    share = half.dtype.type(0.5)
    for c in range(length):
        half[c] = line[2 * c + 1] + share * (line[2 * c] + line[2 * c + 2])
    half[length] = half[0]


@inner
def halve_even(line: Array, length: int, half: Array) -> None:
    """The same from the first number on."""
    share = half.dtype.type(0.5)
    half[0] = line[0] + share * (line[2 * length - 1] + line[1])
    for c in range(1, length):
        half[c] = line[2 * c] + share * (line[2 * c - 1] + line[2 * c + 1])
