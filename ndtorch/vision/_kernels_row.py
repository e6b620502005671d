"""Kernels of a row of pixels: grey, the filters of the motion detectors, their correlation, decimation of columns."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch.utils.jit import jit

Array = Any


@jit
def filter_row(
    colors: tuple[Array, Array, Array],
    third: float,
    settle: bool,
    slow: Array,
    delayed: Array,
    shares: tuple[float, float],
    image: Array,
    high: Array,
) -> tuple[float, float, float]:
    """Grey and `motion_step` of one row in one loop: every number is read and written once.

    Numbers that have died away become zero: as denormals they would make every later frame ten times slower.

    Args:
        colors: red, green and blue.
        third: scales their sum to grey in 0..1.
        settle: the state before is that of filters settled on this row, whatever is given.
        slow, delayed: states, which become those after it. None of these arrays may overlap another: loops would not
            be made of vector instructions.
        shares: of the high-pass and of the low-pass.
        image, high: become grey and the high-passed row.

    Returns:
        Sums of the colors.
    """
    kind = image.dtype.type
    tiny, a_high, a_low = kind(1e-30), kind(shares[0]), kind(shares[1])
    red, green, blue = colors
    r, g, b = kind(0), kind(0), kind(0)
    for x in range(image.shape[0]):
        one, two, three = kind(red[x]), kind(green[x]), kind(blue[x])
        r, g, b = r + one, g + two, b + three
        grey = (one + two + three) * third
        image[x] = grey
        mean, last = (grey, kind(0)) if settle else (slow[x], delayed[x])
        mean = mean + a_high * (grey - mean)
        fast = grey - mean
        last = last + a_low * (fast - last)
        high[x] = fast
        delayed[x] = last if abs(last) > tiny else kind(0)
        slow[x] = mean if abs(mean) > tiny else kind(0)
    return r, g, b


@jit
def outside(colors: tuple[Array, Array, Array], unit: float) -> int:
    """How many numbers of three rows are not in 0..1 once they are scaled by `unit`, with some slack, or no numbers."""
    low, high, wrong = -0.01 / unit, 1.01 / unit, 0
    for row in colors:
        for x in range(row.shape[0]):
            wrong += 0 if low <= row[x] <= high else 1
    return wrong


@jit
def correlate(
    high: Array, late: Array, high_before: Array, late_before: Array, lag: int, total: tuple[Array, Array]
) -> None:
    """Sums and sums of magnitudes of `high late' - high' late`: with the left neighbour, and with the row before.

    Args:
        high, late: rows `[R, W]`.
        high_before, late_before: those before each.
        lag: 1, unsigned. Where the compiler knew that, it would shuffle vectors instead of loading neighbours.
        total: the sums across and along are added to these, `[2]` each.
    """
    kind, (rows, width) = high.dtype.type, high.shape
    along_row, over_rows = total
    for y in range(rows):
        across, across_size, along, along_size = kind(0), kind(0), kind(0), kind(0)
        for x in range(width - lag):
            here, now = high[y, x + lag], late[y, x + lag]
            signed = here * late[y, x] - high[y, x] * now
            across, across_size = across + signed, across_size + abs(signed)
            signed = here * late_before[y, x + lag] - high_before[y, x + lag] * now
            along, along_size = along + signed, along_size + abs(signed)
        signed = high[y, 0] * late_before[y, 0] - high_before[y, 0] * late[y, 0]
        along_row[0], along_row[1] = along_row[0] + across, along_row[1] + across_size
        over_rows[0], over_rows[1] = over_rows[0] + along + signed, over_rows[1] + along_size + abs(signed)


@jit
def add_weighted(row: Array, weight: float, total: Array) -> None:
    """`total += weight row`."""
    for x in range(row.shape[0]):
        total[x] += weight * row[x]


@jit
def add_to_two(row: Array, weights: tuple[float, float], here: Array, there: Array) -> None:
    """`add_weighted` to two others."""
    one, two = weights
    for x in range(row.shape[0]):
        here[x] += one * row[x]
        there[x] += two * row[x]


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
