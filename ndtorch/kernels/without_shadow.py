"""What stands out and is no shadow; only what may be one is looked at."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.most_of import inside
from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
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
        core[y] = out[y]
        rows[y] = find_any(out[y], may_be[y], columns)
    first, last = 0, width
    while first < last and not columns[first]:
        first += 1
    while last > first and not columns[last - 1]:
        last -= 1
    first, last = max(0, first - edge), min(width, last + edge)
    even, sums = np.zeros((height + 2 * edge, width + 2 * edge), np.uint8), np.empty((4, width + side))
    before = -2
    for y in range(height):
        if rows[max(0, y - edge) : y + edge + 1].any():
            sum_columns(light, y, before == y - 1, first, last, side, sums[0], sums[1])
            found, may = even[edge + y, edge + first : edge + last], may_be[y, first:last]
            mark_even(sums[0], sums[1], may, side, darkest, uneven, sums[2], sums[3], found)
            before = y
    line = np.empty(width + 2 * edge, np.uint8)
    for y in range(height):
        if not rows[y]:
            continue
        line[:] = 0
        for row in even[y : y + 2 * edge + 1]:
            join_row(row, line)
        for j in range(2 * edge + 1):
            take_away(line[j : j + width], may_be[y], core[y])


@jit
def find_any(out: Array, may_be: Array, columns: Array) -> int:
    """Whether anything in a row may be a shadow, and where: marks are added to the columns'."""
    some = np.uint8(0)
    for x in range(out.shape[0]):
        one = out[x] & may_be[x]
        columns[x] |= one
        some |= one
    return int(some)


@jit
def join_row(row: Array, line: Array) -> None:
    """Add marks to others."""
    for x in range(line.shape[0]):
        line[x] |= row[x]


@jit
def take_away(part: Array, may_be: Array, core: Array) -> None:
    """What may be a shadow is none of the core where that is marked."""
    for x in range(core.shape[0]):
        core[x] &= ~(may_be[x] & part[x])


@jit(exact=True)
def sum_columns(
    light: Array, y: int, again: bool, first: int, last: int, side: int, line: Array, squares: Array
) -> None:
    """Sums of the light of neighbours above and below, and of its squares, from half a side left of the first column.

    Args:
        light: `[h, w]`.
        y: the row.
        again: the sums are those of the row before; they go on from there.
        first, last: columns in which something may be a shadow.
        side: of what counts as neighbours.
        line, squares: become the sums, `[>= last - first + side - 1]`.
    """
    height, width = light.shape
    half, count = side // 2, last - first
    # Columns beyond the edges are those inside, mirrored.
    begin, end = max(0, first - half), min(width, last - half + side - 1)
    part, square_part = line[begin - first + half :], squares[begin - first + half :]
    if again:
        old, new = light[inside(y - 1 - half, height)], light[inside(y - half + side - 1, height)]
        exchange(old[begin:end], new[begin:end], part, square_part)
    else:
        line[:], squares[:] = 0, 0
        for j in range(side):
            add_row(light[inside(y - half + j, height), begin:end], part, square_part)
    for n in range(count + side - 1):
        x = first - half + n
        if x < 0 or x >= width:
            there = inside(x, width) - first + half
            line[n], squares[n] = line[there], squares[there]


@jit(exact=True)
def add_row(row: Array, line: Array, squares: Array) -> None:
    """Add values, and their squares, to sums."""
    for n in range(row.shape[0]):
        value = row[n]
        line[n] += np.float64(value)
        squares[n] += np.float64(value * value)


@jit(exact=True)
def exchange(old: Array, new: Array, line: Array, squares: Array) -> None:
    """Take values and their squares out of sums, and add others."""
    for n in range(old.shape[0]):
        less, more = old[n], new[n]
        line[n] += np.float64(more) - np.float64(less)
        squares[n] += np.float64(more * more) - np.float64(less * less)


@jit(exact=True)
def mark_even(
    line: Array,
    squares: Array,
    may: Array,
    side: int,
    darkest: float,
    uneven: float,
    total: Array,
    square: Array,
    found: Array,
) -> None:
    """Mark the columns of a row where the light varies little among neighbours.

    Args:
        line, squares: of `sum_columns`.
        may: what may be a shadow, 1 or 0, `[n]`.
        side, darkest, uneven: constants.
        total, square: room for n numbers.
        found: becomes the marks, `[n]`.
    """
    count = found.shape[0]
    area, low, limit = 1.0 / (side * side), np.float32(darkest), np.float32(uneven * uneven)
    if side == 5:
        add_five(line, squares, total[:count], square[:count])
    else:
        total[:count], square[:count] = 0, 0
        for n in range(side):
            for k in range(count):
                total[k] += line[n + k]
                square[k] += squares[n + k]
    for k in range(count):
        mean = np.float32(total[k] * area)
        varies = np.float32(square[k] * area) - mean * mean
        found[k] = may[k] & (mean > low) & (varies < limit)


@jit(exact=True)
def add_five(line: Array, squares: Array, total: Array, square: Array) -> None:
    """Sums of five neighbours: in one pass, which takes a third of the time."""
    for k in range(total.shape[0]):
        total[k] = line[k] + line[k + 1] + line[k + 2] + line[k + 3] + line[k + 4]
        square[k] = squares[k] + squares[k + 1] + squares[k + 2] + squares[k + 3] + squares[k + 4]
