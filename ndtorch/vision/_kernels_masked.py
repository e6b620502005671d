"""Compiled passes over masks of tracks: their motion and color, and their ten signals."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from ndtorch.utils.jit import jit

Array = Any
"""An array in a compiled function."""


@jit
def any_nonzero(row: Array) -> bool:
    """Whether a row of whole numbers has one that is not 0. Most rows have none and are skipped by this test."""
    some = np.int32(0)
    for x in range(row.shape[0]):
        some |= np.int32(row[x])
    return bool(some != 0)


@jit
def sum_features(
    image: Array,
    background: Array,
    labels: Array,
    slow: Array,
    delayed: Array,
    shares: tuple[float, float],
    strongest: Array,
    sums: Array,
) -> None:
    """The first part of a step, see `MaskedFeatures.measure`; `slow` and `delayed` become those after the step."""
    kind = image.dtype.type
    _, height, width = slow.shape
    fields = sums.shape[0]
    quarter = kind(0.25)
    high, color = np.empty((3, height, width), image.dtype), np.empty(3, image.dtype)
    upper, lower = np.empty(2 * width, image.dtype), np.empty(2 * width, image.dtype)
    seen, some = np.empty(width, image.dtype), np.empty(height, np.bool_)
    for n in range(fields):
        for k in range(6):
            sums[n, k] = 0
    for y in range(height):
        # Mostly there is no mask, and the filters only fade.
        some[y] = any_nonzero(labels[2 * y]) or any_nonzero(labels[2 * y + 1])
        for x in range(width):
            strongest[y, x] = seen[x] = 0
        for c in range(3):
            if some[y]:
                differ(image[c, 2 * y], background[c, 2 * y], labels[2 * y], upper)
                differ(image[c, 2 * y + 1], background[c, 2 * y + 1], labels[2 * y + 1], lower)
                halve(upper, lower, quarter, seen)
            pass_high(seen, shares, slow[c, y], delayed[c, y], high[c, y], strongest[y])
    for y in range(height):
        for x in range(width if some[y] else 0):
            top = max(labels[2 * y, 2 * x], labels[2 * y, 2 * x + 1])
            name = max(top, max(labels[2 * y + 1, 2 * x], labels[2 * y + 1, 2 * x + 1]))
            if name <= 0:
                continue
            n = (name - 1) % fields
            across, along, grey = 0.0, 0.0, kind(0)
            for c in range(3):
                here, late = np.float64(high[c, y, x]), np.float64(delayed[c, y, x])
                if x + 1 < width:
                    across += high[c, y, x + 1] * late - here * delayed[c, y, x + 1]
                if x:
                    across += here * delayed[c, y, x - 1] - high[c, y, x - 1] * late
                if y + 1 < height:
                    along += high[c, y + 1, x] * late - here * delayed[c, y + 1, x]
                if y:
                    along += here * delayed[c, y - 1, x] - high[c, y - 1, x] * late
                color[c] = quarter * (
                    (image[c, 2 * y, 2 * x] + image[c, 2 * y, 2 * x + 1])
                    + (image[c, 2 * y + 1, 2 * x] + image[c, 2 * y + 1, 2 * x + 1])
                )
                grey += color[c] / 3
            sums[n, 0] += 1
            # What two neighbors make of a motion belongs to both by half.
            sums[n, 1] += 0.5 * across
            sums[n, 2] += 0.5 * along
            for c in range(3):
                sums[n, 3 + c] += max(color[c] - grey, kind(0))


@jit
def differ(image: Array, background: Array, labels: Array, found: Array) -> None:
    """How far labels differ from the background in one color of one row; 0 elsewhere."""
    none = found.dtype.type(0)
    for x in range(found.shape[0]):
        apart_by = image[x] - background[x]
        found[x] = apart_by if labels[x] > 0 else none


@jit(exact=True)
def halve(upper: Array, lower: Array, quarter: float, found: Array) -> None:
    """Means of blocks of two by two pixels. Row by row: that of a mirror image is the same to the last digit."""
    for x in range(found.shape[0]):
        found[x] = ((upper[2 * x] + upper[2 * x + 1]) + (lower[2 * x] + lower[2 * x + 1])) * quarter


@jit
def pass_high(
    seen: Array, shares: tuple[float, float], slow: Array, delayed: Array, high: Array, strongest: Array
) -> None:
    """High-pass and delay of one color of one row, and the largest value of the colors so far."""
    kind = high.dtype.type
    share, lag, tiny, none = kind(shares[0]), kind(shares[1]), kind(1e-30), kind(0)
    for x in range(high.shape[0]):
        here, before, ago = seen[x], slow[x], delayed[x]
        mean = before + share * (here - before)
        fast = here - mean
        late = ago + lag * (fast - ago)
        high[x] = fast
        slow[x] = mean if abs(mean) > tiny else none
        delayed[x] = late if abs(late) > tiny else none
        strongest[x] = max(strongest[x], abs(here))


@jit
def signals_of_sums(strongest: Array, filters: Array, labels: Array, sums: Array, signals: Array) -> None:
    """The second part, see `MaskedFeatures.signals`; `strongest` has margins of half a filter."""
    fields, (rows, _, reach) = sums.shape[0], filters.shape
    height, width = labels.shape[0] // 2, labels.shape[1] // 2
    tilted = np.zeros((fields, 3))
    # So many rows as a filter has, column after column: what a filter covers is one piece. Each new row replaces the
    # oldest, and the filters are turned on with it.
    band = np.zeros(strongest.shape[1] * rows + reach, strongest.dtype)
    for r in range(rows - 1):
        band[r : strongest.shape[1] * rows : rows] = strongest[r]
    for y in range(height):
        newest, turned = (y + rows - 1) % rows, filters[y % rows]
        band[newest : strongest.shape[1] * rows : rows] = strongest[y + rows - 1]
        some = any_nonzero(labels[2 * y]) or any_nonzero(labels[2 * y + 1])
        for x in range(width if some else 0):
            top = max(labels[2 * y, 2 * x], labels[2 * y, 2 * x + 1])
            name = max(top, max(labels[2 * y + 1, 2 * x], labels[2 * y + 1, 2 * x + 1]))
            if name > 0:
                n, here = (name - 1) % fields, band[x * rows : x * rows + reach]
                first, second, third = products(here, turned[0], turned[1], turned[2])
                tilted[n, 0] += abs(first)
                tilted[n, 1] += abs(second)
                tilted[n, 2] += abs(third)
    for n in range(fields):
        pixels = max(sums[n, 0], 1.0)
        across, along = sums[n, 1] / pixels, sums[n, 2] / pixels
        signals[n, 0], signals[n, 1] = sqrt(max(-across, 0.0)), sqrt(max(across, 0.0))
        signals[n, 2], signals[n, 3] = sqrt(max(along, 0.0)), sqrt(max(-along, 0.0))
        least = min(tilted[n, 0], tilted[n, 1], tilted[n, 2])
        for k in range(3):
            signals[n, 4 + k] = sqrt((tilted[n, k] - least) / pixels)
            signals[n, 7 + k] = sqrt(sums[n, 3 + k] / pixels)


@jit
def products(here: Array, one: Array, two: Array, three: Array) -> tuple[float, float, float]:
    """Sums of the products of numbers with those of three filters."""
    kind = here.dtype.type
    first, second, third = kind(0), kind(0), kind(0)
    for n in range(here.shape[0]):
        first += here[n] * one[n]
        second += here[n] * two[n]
        third += here[n] * three[n]
    return first, second, third
