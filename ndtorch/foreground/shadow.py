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
from ndtorch.foreground.morphology import WORD, dilate, mirrored, pack, row_of
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
def remove_shadow(
    core: Array,
    light: Array,
    shadow: Array,
    limits: ShadowLimits,
    inside: Array,
    margin: int,
    room: tuple[Array, Array],
) -> None:
    """Remove shadow from foreground candidates.

    Args:
        core: the candidates, a mask with margins (see `ndtorch.foreground.morphology`).
        light: mean ratio of the image's colors to the background's, `[h, w]`.
        shadow: 1 for shadow candidates, `[h, w]` uint8.
        inside, margin, room: of `opening`; the margin is at least `WINDOW_PX`.
    """
    (height, width), edge, side = shadow.shape, PENUMBRA_PX, WINDOW_PX
    line = inside.shape[0]
    dark, even = np.zeros_like(core), np.zeros_like(core)
    # Only rows and columns with shadow candidates in the foreground are looked at.
    rows, columns = np.zeros(height + 2 * edge, np.bool_), np.zeros(line, np.uint64)
    for y in range(height):
        there, some = row_of(dark, y, line, margin), np.uint64(0)
        pack(shadow[y], there)
        here = row_of(core, y, line, margin)
        for k in range(line):
            columns[k] |= here[k] & there[k]
            some |= here[k] & there[k]
        if some:
            rows[y : y + 2 * edge + 1] = True
    first, last = 0, width
    while first < last and not bit(columns, first):
        first += 1
    while last > first and not bit(columns, last - 1):
        last -= 1
    first, last = max(0, first - edge), min(width, last + edge)
    sums, found, before = np.empty((2, width + side)), np.zeros(width, np.uint8), -2
    for y in range(height):
        if rows[y + edge]:
            sum_columns(light, y, before == y - 1, (first, last), sums[0], sums[1])
            mark_even(sums[0], sums[1], shadow[y, first:last], limits, found[first:last])
            pack(found, row_of(even, y, line, margin))
            before = y
    dilate(even, 2 * edge + 1, inside, margin, room)
    for n in range(core.shape[0]):
        core[n] &= ~(dark[n] & even[n])


@jit
def bit(bits: Array, x: int) -> bool:
    return bool((bits[x // WORD] >> np.uint64(x % WORD)) & np.uint64(1))


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
