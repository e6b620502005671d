"""Compiled: ranges from the horizon rows, by features and their partners as `find_features` and `match_features`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.navigation.stereo._kernels import Array, Frames, grey_row, high_pass, is_finite
from ndtorch.utils.jit import jit

EDGE_SIDE, SAME_EDGE, BLUR = 1.5, 1.5, 2
"""As in `ndtorch.navigation.stereo.features`."""


class FeatureNumbers(NamedTuple):
    """`FeatureParams` and `MatchParams` of a rig.

    Attributes:
        features: how many.
        border: columns at the outer border of both rows in which no feature is looked for.
        band_start, band_end: columns among which `ahead` features are looked for first.
        a: share of the high-pass of the rows.
    """

    features: int
    spacing: int
    min_motion: float
    min_difference: float
    edge_reach: int
    border: int
    ahead: int
    band_start: int
    band_end: int
    min_disparity: float
    max_disparity: float
    one_to_one: bool
    max_error: float
    a: float


class RowGeometry(NamedTuple):
    """What turns columns into ranges: column of the axes, factor to angles (which are `exact` or linear), m, m."""

    axis: float
    factor: float
    baseline: float
    forward: float
    exact: bool


@jit
def feature_ranges(
    frames: Frames,
    settle: bool,
    low: Array,
    new_low: Array,
    numbers: Array,
    geometry: Array,
    out: Array,
    valid: Array,
) -> float:
    """The step of `StereoRanging` that matches features without prediction; returns the largest motion.

    Args:
        frames: `tops[0]` is the row that is read of both.
        settle: the filters start at rest on these rows.
        low, new_low: states of the filters, `[2, W]`.
        numbers, geometry: `packed` `FeatureNumbers` and `RowGeometry`.
        out: becomes range, left and right angle, x and y, `[5, n]`; `valid`: `[n]`.
    """
    p, width = numbers[0], low.shape[1]
    rows, motion = np.empty((2, width), low.dtype), np.empty(width, low.dtype)
    now, before, after = rows.reshape(-1), low.reshape(-1), new_low.reshape(-1)
    column, strength = np.empty((2, p.features), low.dtype), np.empty((2, p.features), low.dtype)
    patch, good = np.empty((2, p.features, 3), low.dtype), np.empty((2, p.features), np.bool_)
    most, bits = low.dtype.type(0), motion.view(np.int32)
    for eye in range(2):
        frame = frames.right if eye else frames.left
        grey_row(frame, frames.interleaved, frames.tops[0], np.intp(0), np.intp(1), frames.scale, rows[eye])
        high_pass(now, before, eye * width, settle, p.a, after, motion)
        for x in range(width):
            most = max(most, motion[x])
        for x in range(p.border):
            motion[width - 1 - x if eye else x] = 0
        strongest(motion, bits, p, column[eye], strength[eye])
        describe(rows[eye], column[eye], strength[eye], p, patch[eye], good[eye])
    match(column, patch, good, p, out[0], valid)
    triangulate(column[0], geometry, out, valid)
    return float(most) if frames.left.itemsize == 1 or is_finite(rows) else np.nan


@jit(exact=True)
def triangulate(column: Array, geometry: Array, out: Array, valid: Array) -> None:
    """Range, left and right angle, x and y into `out` `[5, n]`, whose first line holds the right columns before.

    Args:
        column: left columns, `[n]`.
        geometry: `packed` `RowGeometry`.
        valid: `[n]`; what is not valid, or does not meet ahead, becomes 0.
    """
    kind = out.dtype.type
    g = geometry[0]
    factor, baseline, middle = kind(g.factor), g.baseline, kind(g.axis)
    for i in range(len(column)):
        left, right = (middle - column[i]) * factor, (middle - out[0, i]) * factor
        if g.exact:
            left, right = kind(math.atan(left)), kind(math.atan(right))
        valid[i] = valid[i] and right > left
        if valid[i]:
            distance = kind(baseline) * math.cos(right) / math.sin(right - left)
            out[0, i], out[1, i], out[2, i] = distance, left, right
            out[3, i] = kind(g.forward) + distance * math.cos(left)
            out[4, i] = kind(baseline / 2) + distance * math.sin(left)
        else:
            out[0, i] = out[1, i] = out[2, i] = out[3, i] = out[4, i] = 0


STRIDE = 32


@jit(exact=True)
def largest(whole: Array, start: int, end: int) -> int:
    """Where the largest from one column up to another is, the first of them; 0 where there are none."""
    if not start < end:
        return 0
    most = whole[start]
    for x in range(start + 1, end):
        most = max(most, whole[np.uintp(x)])
    # Some at once, in vector instructions, up to those among which it is.
    best, found = start, False
    while not found and best + STRIDE <= end:
        for x in range(best, best + STRIDE):
            found |= whole[np.uintp(x)] == most
        best += 0 if found else STRIDE
    while whole[best] != most:
        best += 1
    return best


@jit(exact=True)
def strongest(motion: Array, whole: Array, numbers: FeatureNumbers, column: Array, strength: Array) -> None:
    """The largest of `motion` `[W]`, one after the other; it is spoiled.

    Args:
        whole: the bits of the same numbers, which are in the same order.
    """
    width = motion.shape[0]
    motion[0] = motion[width - 1] = -1
    ahead, start, end, spacing = numbers.ahead, numbers.band_start, numbers.band_end, numbers.spacing
    for k in range(column.shape[0]):
        best = largest(whole, start, end) if k < ahead else 0
        if not motion[best] > 0:
            best = largest(whole, np.intp(0), width)
        column[k], strength[k] = best, motion[best]
        for x in range(max(0, best - spacing), min(best + spacing + 1, width)):
            motion[x] = -1


@jit(exact=True)
def edge_place(row: Array, column: int, reach: int) -> float:
    """Where the edge is that made the motion at a column, see `edge_places`."""
    kind, width = row.dtype.type, row.shape[0]
    edge, size = 0, kind(-1)
    for k in range(column - reach - 1, column + reach + 1):
        at = min(max(k, 0), width - 2)
        step = abs(row[at + 1] - row[at])
        if step > size:
            edge, size = at, step
    sign = np.sign(row[edge + 1] - row[edge])
    total, moment = kind(0), kind(0)
    for k in range(edge - BLUR, edge + BLUR + 1):
        at = min(max(k, 0), width - 2)
        weight = max((row[at + 1] - row[at]) * sign, kind(0))
        total, moment = total + weight, moment + weight * kind(at - edge)
    place = moment / total if total > 0 else kind(0)
    inside: float = min(max(place + kind(edge) + kind(0.5), kind(1)), kind(width - 2))
    return inside


@jit(exact=True)
def between(row: Array, place: float) -> float:
    """The row at a fraction of a pixel."""
    kind, width = row.dtype.type, row.shape[0]
    place = min(max(place, kind(0)), kind(width - 1))
    low = min(int(place), width - 2)
    share, left, right = place - kind(low), row[low], row[low + 1]
    worth: float = left + share * (right - left) if share < kind(0.5) else right - (right - left) * (kind(1) - share)
    return worth


@jit(exact=True)
def patch_error(one: Array, other: Array) -> float:
    """Squared difference of two patches."""
    a, b, c = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    total: float = a * a + b * b + c * c
    return total


@jit(exact=True)
def describe(row: Array, column: Array, strength: Array, numbers: FeatureNumbers, patch: Array, good: Array) -> None:
    """`describe` of `ndtorch.navigation.stereo.features`: places, patches `[n, 3]`, and which features are good."""
    kind, n, width = row.dtype.type, column.shape[0], row.shape[0]
    spacing, reach = numbers.spacing, numbers.edge_reach
    weakest, difference = numbers.min_motion, numbers.min_difference
    crowded = width - 2 < n * (2 * spacing + 1)
    for i in range(n):
        if crowded:
            column[i] = min(max(column[i], kind(1)), kind(width - 2))
        if reach:
            column[i] = edge_place(row, int(column[i]), reach)
            for k in range(3):
                patch[i, k] = between(row, column[i] + kind(EDGE_SIDE * (k - 1)))
        else:
            for k in range(3):
                patch[i, k] = row[int(column[i]) - 1 + k]
        good[i] = strength[i] >= kind(weakest)
    if n == 1:
        return
    twin = np.empty(n, np.bool_)
    for i in range(n):
        twin[i] = False
        if reach:
            for j in range(n):
                less = strength[i] < strength[j] or (strength[i] == strength[j] and j < i)
                if less and abs(column[i] - column[j]) < kind(SAME_EDGE):
                    twin[i] = True
    for i in range(n):
        for j in range(n):
            counts = i != j and not twin[j] and not (crowded and strength[j] < 0)
            if counts and not patch_error(patch[i], patch[j]) >= kind(difference):
                good[i] = False
        good[i] = good[i] and not twin[i]


@jit(exact=True)
def match(column: Array, patch: Array, good: Array, numbers: FeatureNumbers, partner: Array, valid: Array) -> None:
    """`match_features` of both rows, `[2, n]`: the partner's column of every left feature, and whether it is one."""
    kind, n = column.dtype.type, column.shape[1]
    least, most, one_to_one, limit = numbers.min_disparity, numbers.max_disparity, numbers.one_to_one, numbers.max_error
    error = np.empty((n, n), column.dtype)
    for i in range(n):
        for j in range(n):
            known = good[0, i] and good[1, j]
            error[i, j] = patch_error(patch[0, i], patch[1, j]) if known else kind(math.inf)
    for i in range(n):
        j = 0
        for k in range(1, n):
            if error[i, k] < error[i, j]:
                j = k
        partner[i] = column[1, j]
        apart = column[0, i] - column[1, j]
        valid[i] = error[i, j] < limit and kind(least) < apart < kind(most)
        if one_to_one:
            for k in range(n):
                # The first of those that are alike is the one.
                if error[k, j] < error[i, j] or (k < i and error[k, j] == error[i, j]):
                    valid[i] = False
