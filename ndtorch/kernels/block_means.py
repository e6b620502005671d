"""A frame averaged over blocks, in one pass over its pixels."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.utils.jit import jit


@jit
def block_means(lines: Array, beside: int, unit: float, sums: Array, means: Array) -> None:
    """`torch.nn.functional.adaptive_avg_pool2d` of the three colors.

    Args:
        lines: the frame, `[3 / beside, H, W beside]`.
        beside: how many colors lie beside each other, 1 or 3.
        unit: factor that scales pixels to 0..1.
        sums: memory for sums over rows, and over two, four and eight neighbours of those, `[4, W beside]`: whole
            numbers where pixels are.
        means: becomes the averages, `[3, h, w]`.
    """
    planes, height, length = lines.shape
    _, rows, columns = means.shape
    width = length // beside
    one, two, four, eight = sums[0], sums[1], sums[2], sums[3]
    begins, ends, block = np.empty(columns, np.int64), np.empty(columns, np.int64), np.empty(columns, sums.dtype)
    for column in range(columns):
        begins[column], ends[column] = column * width // columns, ((column + 1) * width + columns - 1) // columns
    for plane in range(planes):
        for row in range(rows):
            top, bottom = row * height // rows, ((row + 1) * height + rows - 1) // rows
            one[:] = 0
            y = top
            while y + 4 <= bottom:
                add_four(lines[plane, y], lines[plane, y + 1], lines[plane, y + 2], lines[plane, y + 3], one)
                y += 4
            while y < bottom:
                add_one(lines[plane, y], one)
                y += 1
            # Neighbours of all columns at once: of a block, sums of eight, four, two and one are left to add.
            pairs(one[: length - beside], one[beside:], two)
            pairs(two[: max(0, length - 3 * beside)], two[2 * beside :], four)
            pairs(four[: max(0, length - 7 * beside)], four[4 * beside :], eight)
            for color in range(beside):
                block_sums(sums, begins, ends, beside, color, block)
                for column in range(columns):
                    scale = unit / ((bottom - top) * (ends[column] - begins[column]))
                    means[plane * beside + color, row, column] = block[column] * scale


@jit
def block_sums(sums: Array, begins: Array, ends: Array, beside: int, color: int, block: Array) -> None:
    """Sums of the numbers from `begins` to `ends`, by those of eight, four and two neighbours."""
    one, two, four, eight = sums[0], sums[1], sums[2], sums[3]
    for column in range(block.shape[0]):
        x, wide = begins[column] * beside + color, ends[column] - begins[column]
        total = sums.dtype.type(0)
        while wide >= 8:
            total += eight[x]
            x, wide = x + 8 * beside, wide - 8
        if wide & 4:
            total += four[x]
            x += 4 * beside
        if wide & 2:
            total += two[x]
            x += 2 * beside
        if wide & 1:
            total += one[x]
        block[column] = total


@jit
def add_four(a: Array, b: Array, c: Array, d: Array, total: Array) -> None:
    """Add four rows of pixels at once."""
    kind = total.dtype.type
    for x in range(total.shape[0]):
        total[x] += kind(a[x]) + kind(b[x]) + kind(c[x]) + kind(d[x])


@jit
def add_one(row: Array, total: Array) -> None:
    """Add a row of pixels."""
    kind = total.dtype.type
    for x in range(total.shape[0]):
        total[x] += kind(row[x])


@jit
def pairs(one: Array, other: Array, both: Array) -> None:
    """Sums of two numbers each."""
    for x in range(one.shape[0]):
        both[x] = one[x] + other[x]
