"""Kernels of the proximity check: matching of two rows, and correlation of the floor in two images."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]
Bits = npt.NDArray[np.int32]

NO_MATCH = np.float32(9.0)
"""Cost of windows that leave their row; two windows of intensities 0..1 cannot differ by more than 1."""

NO_MATCH_BITS = NO_MATCH.view(np.int32)

NEIGHBOURS = 4
"""Disparities this near to the best one are not counted as elsewhere."""


class MatchCosts(NamedTuple):
    """Two rows matched, for every column of the left one `[W]`.

    Attributes:
        best: the disparity of least cost, less the first one that was tried.
        back: the same of its partner in the right row, matched with the left one.
        cost: at that disparity, the mean absolute difference of two windows.
        elsewhere: the least cost at other disparities.
    """

    best: Indices
    back: Indices
    cost: Floats
    elsewhere: Floats


@jit
def match_rows(left: Floats, right: Floats, first: int, high: int, half: int) -> MatchCosts:
    """Match rows `[W]` at the disparities from `first` up to `high` by windows of `half` columns to either side."""
    width, size, depth = len(left), 2 * half + 1, high - first
    best, back = np.zeros(width, np.int64), np.zeros(width, np.int64)
    cost, elsewhere = np.full(width, NO_MATCH), np.full(width, NO_MATCH)
    # By disparity: sums of the windows that end at the present column, and the differences in them, oldest replaced.
    sums, windows, costs = np.zeros(depth, np.float32), np.zeros((size, depth), np.float32), np.empty(depth, np.float32)
    share = np.float32(1 / size)
    # The right row and what is found of it are reversed, so that the inner loops read neighbours in memory.
    turned, right_best = np.zeros(width + high, np.float32), np.zeros(width + high, np.int32)
    for x in range(width):
        turned[x] = right[width - 1 - x]
    right_cost = np.full(width + high, NO_MATCH)
    # Costs are compared by their bits, which have the same order: only minima of integers become vector instructions.
    bits, right_bits = costs.view(np.int32), right_cost.view(np.int32)
    for c in range(first, width):
        start, slot = width - 1 - c + first, c % size
        accumulate(left[c], turned[start:], min(depth, c - first + 1), windows[slot], sums)
        middle, count = c - half, min(depth, c - first - size + 2)
        if count <= 0:
            continue
        for k in range(count):
            costs[k] = max(sums[k] * share, np.float32(0))  # rounding may leave a little less than 0
        keep_lower(bits, count, right_bits[start + half :], right_best[start + half :])
        lowest, at = least(bits, count), 0
        while bits[at] != lowest:
            at += 1
        best[middle], cost[middle] = at, costs[at]
        for k in range(max(0, at - NEIGHBOURS), min(at + NEIGHBOURS + 1, depth)):
            bits[k] = NO_MATCH_BITS
        least_elsewhere = least(bits, count)
        for k in range(count):
            if bits[k] == least_elsewhere:
                elsewhere[middle] = costs[k]
                break
    for c in range(width):
        back[c] = right_best[width - 1 - min(max(c - first - best[c], 0), width - 1)]
    return MatchCosts(best, back, cost, elsewhere)


@jit
def accumulate(here: float, right: Floats, count: int, window: Floats, sums: Floats) -> None:
    """Replace the differences of one column in the sums over a window."""
    for k in range(count):
        difference = abs(here - right[k])
        sums[k] += difference - window[k]
        window[k] = difference


@jit
def keep_lower(costs: Bits, count: int, lowest: Bits, at: Bits) -> None:
    """Lower costs replace the lowest ones, and their disparities."""
    for k in range(count):
        at[k] = k if costs[k] < lowest[k] else at[k]
        lowest[k] = min(lowest[k], costs[k])


@jit
def least(values: Bits, count: int) -> np.int32:
    found = NO_MATCH_BITS
    for k in range(count):
        found = min(found, values[k])
    return found


class FloorGeometry(NamedTuple):
    """Where both images see the floor ahead.

    Attributes:
        top, left, right_top, right_left: corners of the left and of the right rectangle in the image, pixels.
        disparity_per_row: of the floor, baseline over height of the cameras.
        horizon, center: row and column of the optical axis, pixels.
        half_width: of the floor that is compared, in baselines.
    """

    top: int
    left: int
    right_top: int
    right_left: int
    disparity_per_row: float
    horizon: float
    center: float
    half_width: float


@jit
def floor_correlation_of(
    left: Floats,
    right: Floats,
    rows: Indices,
    tilts: Indices,
    geometry: FloorGeometry,
    enough: float,
    minima: tuple[int, int, float],
) -> float:
    """The largest correlation of floor pixels in both images over tilts of the horizon.

    Args:
        left, right: subfields `[h, w]` in 0..1.
        rows: of the image, that see the floor ahead.
        tilts: rows by which the horizon is higher; no further one is tried once a correlation is `enough`.
        minima: columns of a row, pixels in all, and standard deviation of the brightness that are compared.
    """
    g, width, right_width = geometry, left.shape[1], right.shape[1]
    min_columns, min_pixels, min_sigma = minima
    best = 0.0
    for t in range(len(tilts)):
        count, both, square, right_square = 0, 0.0, 0.0, 0.0
        for row in rows:
            shift = round(g.disparity_per_row * (row - g.horizon + tilts[t]))
            # Columns of the left image straight ahead of the car, whose partners lie in the right subfield.
            begin, end = max(g.left, g.right_left + shift), min(g.left + width, g.right_left + shift + right_width)
            first = max(begin, math.ceil(g.center + shift / 2 - g.half_width * shift))
            last = min(end, math.floor(g.center + shift / 2 + g.half_width * shift) + 1)
            if last - first < min_columns:
                continue
            here = left[row - g.top, first - g.left : last - g.left]
            there = right[row - g.right_top, first - shift - g.right_left : last - shift - g.right_left]
            # Less the means of the row, since the foot of a wall lies in one row of both images.
            mean, right_mean = np.float32(here.mean()), np.float32(there.mean())
            count += last - first
            for c in range(last - first):
                a, b = here[c] - mean, there[c] - right_mean
                both, square, right_square = both + a * b, square + a * a, right_square + b * b
        correlation = 0.0
        if count >= max(1, min_pixels) and min(square, right_square) >= count * min_sigma**2:
            correlation = both / math.sqrt(square * right_square)
        best = correlation if t == 0 else max(best, correlation)
        if best >= enough:
            break
    return best
