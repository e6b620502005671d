"""Columns of an image halved as its rows are by `halve_rows`, with mirrored margins at both sides."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.inner import inner


@inner
def halve_columns(rows: Array, margin: int, image: Array) -> None:
    """`halve_rows` of the columns, as often as it takes.

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
    padded, halves = np.empty(length, rows.dtype), np.empty((max(times - 1, 1), length // 2), rows.dtype)
    for y in range(height):
        row = rows[y]
        if margin:
            for x in range(width):
                padded[margin + x] = row[x]
            for x in range(margin):
                padded[x] = row[margin - x]
                padded[margin + width + x] = row[width - 2 - x]
            row = padded
        for level in range(times - 1):
            halve_line(row, length >> (level + 1), halves[level])
            row = halves[level]
        if times:
            halve_line(row, length >> times, image[y])
        else:
            for x in range(length):
                image[y, x] = row[x]


@inner
def halve_line(line: Array, length: int, half: Array) -> None:
    """Half of the numbers of a closed line, `length` of them, smoothed with weights 1/2, 1, 1/2 beforehand."""
    share = half.dtype.type(0.5)
    half[0] = line[0] + share * (line[2 * length - 1] + line[1])
    for c in range(1, length):
        half[c] = line[2 * c] + share * (line[2 * c - 1] + line[2 * c + 1])
