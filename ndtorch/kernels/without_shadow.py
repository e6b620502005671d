"""What stands out and is no shadow; only what may be one is looked at."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.inner import exactly
from ndtorch.kernels.most_of import inside


def without_shadow(
    out: Array, light: Array, may_be: Array, side: int, edge: int, darkest: float, uneven: float, core: Array
) -> None:
    """`out` without `ndtorch.vision.camera.figures.shadow`.

    Args:
        out, may_be: 1 where a pixel stands out, and where it may be shadow, `[h, w]` uint8.
        light: of the picture over that of the ground, `[h, w]`.
        side, edge, darkest, uneven: constants.
        core: becomes 1 where a pixel stands out and is no shadow, `[h, w]` uint8.
    """
    height, width = out.shape
    # Rows and columns in which anything may be a shadow.
    rows, columns = np.zeros(height, np.uint8), np.zeros(width, np.uint8)
    for y in range(height):
        some = np.uint8(0)
        for x in range(width):
            one = out[y, x] & may_be[y, x]
            core[y, x] = out[y, x]
            columns[x] |= one
            some |= one
        rows[y] = some
    first, last = 0, width
    while first < last and not columns[first]:
        first += 1
    while last > first and not columns[last - 1]:
        last -= 1
    first, last = max(0, first - edge), min(width, last + edge)
    even, sums = np.zeros((height + 2 * edge, width + 2 * edge), np.uint8), np.empty((4, width + side))
    for y in range(height):
        if rows[max(0, y - edge) : y + edge + 1].any():
            mark_even(light, may_be, y, first, last, side, darkest, uneven, sums, even[edge + y, edge:])
    line = np.empty(width + 2 * edge, np.uint8)
    for y in range(height):
        if not rows[y]:
            continue
        line[:] = 0
        for row in even[y : y + 2 * edge + 1]:
            for x in range(width + 2 * edge):
                line[x] |= row[x]
        for j in range(2 * edge + 1):
            part = line[j : j + width]
            for x in range(width):
                core[y, x] &= ~(may_be[y, x] & part[x])


@exactly
def mark_even(
    light: Array,
    may_be: Array,
    y: int,
    first: int,
    last: int,
    side: int,
    darkest: float,
    uneven: float,
    sums: Array,
    even: Array,
) -> None:
    """Mark the columns of a row from the first to the last where the light varies little among neighbours."""
    height, width = light.shape
    kind, half, count = light.dtype.type, side // 2, last - first
    # Columns beyond the edges are those inside, mirrored.
    begin, end = max(0, first - half), min(width, last - half + side - 1)
    line, squares = sums[0], sums[1]
    line[: count + side], squares[: count + side] = 0, 0
    # Slices, as an index that might be below zero would be looked at every time.
    part, square_part = line[begin - first + half :], squares[begin - first + half :]
    for j in range(side):
        row = light[inside(y - half + j, height), begin:end]
        for n in range(end - begin):
            value = row[n]
            part[n] += np.float64(value)
            square_part[n] += np.float64(value * value)
    for n in range(count + side - 1):
        x = first - half + n
        if x < 0 or x >= width:
            there = inside(x, width)
            for j in range(side):
                value = light[inside(y - half + j, height), there]
                line[n] += np.float64(value)
                squares[n] += np.float64(value * value)
    area, low, limit = 1.0 / (side * side), kind(darkest), kind(uneven * uneven)
    total, square = sums[2], sums[3]
    total[:count], square[:count] = 0, 0
    for n in range(side):
        part, square_part = line[n : n + count], squares[n : n + count]
        for k in range(count):
            total[k] += part[k]
            square[k] += square_part[k]
    found, may = even[first:last], may_be[y, first:last]
    for k in range(count):
        mean = kind(total[k] * area)
        varies = kind(square[k] * area) - mean * mean
        found[k] = may[k] & (mean > low) & (varies < limit)
