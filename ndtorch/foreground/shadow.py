"""Shadows: pixels that only lost light, by the same share in all colors and among neighbours, are no foreground.

A pixel is a *shadow candidate* if its ratio to the background is below 1, above `shadow_min_ratio`, and differs between
the colors by at most `shadow_max_tint_ratio`. Candidates whose ratio varies little within a window are shadow, and so
are the candidates around them: the penumbra, where neighbours differ. What is left of a shadow is narrow; a candidate
with hardly any tint (`NARROW_TINT`) outside of broad foreground may be such a *narrow shadow*.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ndtorch.foreground.arrays import Array
from ndtorch.foreground.morphology import mirrored
from ndtorch.utils.jit import jit

WINDOW_PX = 5
"""The variation of the light is measured in windows of this side."""
PENUMBRA_PX = 2
"""A shadow's edge is this wide."""
LIGHT_OFFSET = 0.02
"""This much light is added to image and background before their ratio is taken."""
NARROW_TINT = 0.05
"""A narrow shadow changes the colors' shares by at most this."""
MIN_COLORFULNESS = 0.015
"""Narrow shadows are looked for if the background has this mean distance between its largest and smallest color."""


class ShadowLimits(NamedTuple):
    """Constants of `remove_shadow`."""

    min_ratio: float
    max_variation: float


@jit
def remove_shadow(candidates: Array, light: Array, shadow: Array, limits: ShadowLimits, core: Array) -> None:
    """Foreground candidates without shadow.

    Args:
        candidates, shadow: 1 for foreground and shadow candidates, `[h, w]` uint8.
        light: mean ratio of the image's colors to the background's, `[h, w]`.
        core: becomes 1 where a pixel is foreground and no shadow, `[h, w]` uint8.
    """
    height, width = candidates.shape
    edge, side = PENUMBRA_PX, WINDOW_PX
    # Only rows and columns with shadow candidates in the foreground are looked at.
    rows, columns = np.zeros(height, np.uint8), np.zeros(width, np.uint8)
    for y in range(height):
        core[y] = candidates[y]
        rows[y] = find_any(candidates[y], shadow[y], columns)
    first, last = 0, width
    while first < last and not columns[first]:
        first += 1
    while last > first and not columns[last - 1]:
        last -= 1
    first, last = max(0, first - edge), min(width, last + edge)
    even, sums = np.zeros((height + 2 * edge, width + 2 * edge), np.uint8), np.empty((2, width + side))
    before = -2
    for y in range(height):
        if rows[max(0, y - edge) : y + edge + 1].any():
            sum_columns(light, y, before == y - 1, (first, last), sums[0], sums[1])
            found = even[edge + y, edge + first : edge + last]
            mark_even(sums[0], sums[1], shadow[y, first:last], limits, found)
            before = y
    line = np.empty(width + 2 * edge, np.uint8)
    for y in range(height):
        if not rows[y]:
            continue
        line[:] = 0
        for row in even[y : y + 2 * edge + 1]:
            add_marks(row, line)
        for j in range(2 * edge + 1):
            subtract(line[j : j + width], shadow[y], core[y])


@jit
def find_any(candidates: Array, shadow: Array, columns: Array) -> int:
    """Whether a row has foreground that may be shadow; its columns are added to `columns`."""
    some = np.uint8(0)
    for x in range(candidates.shape[0]):
        one = candidates[x] & shadow[x]
        columns[x] |= one
        some |= one
    return int(some)


@jit
def add_marks(row: Array, line: Array) -> None:
    for x in range(line.shape[0]):
        line[x] |= row[x]


@jit
def subtract(marks: Array, shadow: Array, core: Array) -> None:
    """Remove marked shadow candidates from the core."""
    for x in range(core.shape[0]):
        core[x] &= ~(shadow[x] & marks[x])


@jit(exact=True)
def sum_columns(light: Array, y: int, again: bool, columns: tuple[int, int], line: Array, squares: Array) -> None:
    """Sums of the light and of its squares over the rows of a window, from half a window left of the first column.

    Args:
        light: `[h, w]`.
        again: the sums are those of the row before and go on from there.
        columns: the first, and the one after the last.
        line, squares: become the sums.
    """
    (height, width), side = light.shape, WINDOW_PX
    half, (first, last) = side // 2, columns
    begin, end = max(0, first - half), min(width, last - half + side - 1)
    part, square_part = line[begin - first + half :], squares[begin - first + half :]
    if again:
        old, new = light[mirrored(y - 1 - half, height)], light[mirrored(y - half + side - 1, height)]
        exchange(old[begin:end], new[begin:end], part, square_part)
    else:
        line[:], squares[:] = 0, 0
        for j in range(side):
            add_row(light[mirrored(y - half + j, height), begin:end], part, square_part)
    for n in range(last - first + side - 1):
        x = first - half + n
        if x < 0 or x >= width:
            there = mirrored(x, width) - first + half
            line[n], squares[n] = line[there], squares[there]


@jit(exact=True)
def add_row(row: Array, line: Array, squares: Array) -> None:
    for n in range(row.shape[0]):
        value = row[n]
        line[n] += np.float64(value)
        squares[n] += np.float64(value * value)


@jit(exact=True)
def exchange(old: Array, new: Array, line: Array, squares: Array) -> None:
    """Take one row out of the sums and add another."""
    for n in range(old.shape[0]):
        less, more = old[n], new[n]
        line[n] += np.float64(more) - np.float64(less)
        squares[n] += np.float64(more * more) - np.float64(less * less)


@jit(exact=True)
def mark_even(line: Array, squares: Array, shadow: Array, limits: ShadowLimits, found: Array) -> None:
    """Mark shadow candidates in whose window the light varies little; line and squares are those of `sum_columns`."""
    area = 1.0 / (WINDOW_PX * WINDOW_PX)
    low, limit = np.float32(limits.min_ratio), np.float32(limits.max_variation * limits.max_variation)
    for k in range(found.shape[0]):
        total = line[k] + line[k + 1] + line[k + 2] + line[k + 3] + line[k + 4]
        square = squares[k] + squares[k + 1] + squares[k + 2] + squares[k + 3] + squares[k + 4]
        mean = np.float32(total * area)
        variance = np.float32(square * area) - mean * mean
        found[k] = shadow[k] & (mean > low) & (variance < limit)
