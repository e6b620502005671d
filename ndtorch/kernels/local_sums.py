"""One pass over a frame for many receptive fields: what `front_end` does, with sums over every field."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array, filter_row, outside
from ndtorch.kernels.front_end import add_mirrored
from ndtorch.kernels.thinned_columns import thin_columns
from ndtorch.utils.jit import jit


@jit
def local_sums(
    frame: Array,
    beside: bool,
    unit: float,
    settle: bool,
    slow: Array,
    delayed: Array,
    a_high: float,
    a_low: float,
    wrap: bool,
    block: int,
    margins: tuple[int, int],
    every: int,
    image: Array,
    columns: Array,
    starts: Array,
    places: Array,
    shares: Array,
    sums: Array,
) -> int:
    """Motion and color in every field of `LocalFeatures`.

    Args:
        frame, beside, unit, settle, slow, delayed, a_high, a_low, wrap, block, margins, every: as of `front_end`, like
            image, which is filled.
        columns: weights of pixels, and of what lies between them, in each column of fields, `[2, C, K]`.
        starts: the first of those K pixels, `[2, C]`; they may go on at the other border.
        places: the two rows of fields to which a row of pixels belongs, and what lies below it, `[2, H, 2]`.
        shares: how much, `[2, H, 2]`.
        sums: left, right, down, up, red, green, blue, `[7, R, C]`; they become those of this frame.

    Returns:
        How many pixels of those looked at are not in 0..1.
    """
    height, width = slow.shape
    kind = slow.dtype.type
    third, filters = kind(unit / 3), (a_high, a_low)
    grey, margin = np.empty(width, slow.dtype), margins[0]
    # The first row is kept for where the torus closes; the others take turns.
    highs = np.empty((4, width), slow.dtype)
    rows, wrong = np.zeros((image.shape[0], width), slow.dtype), 0
    # Rows first: what belongs to a row of fields stays in the cache while it grows. Two rows at a time, for each is
    # added to two rows of fields, which are read and written half as often so.
    bands = np.zeros((7, sums.shape[1], width), slow.dtype)
    for y in range(0, height, 2):
        below, above = min(y + 1, height - 1), max(y - 1, 0)
        for line in range(y, below + 1):
            if beside:
                colors = (frame[line, :, 0], frame[line, :, 1], frame[line, :, 2])
                filter_row(colors, third, settle, slow[line], delayed[line], filters, grey, highs[turn(line)])
                if every and line % every == 0:
                    wrong += outside(colors, unit)
            else:
                planes = (frame[0, line], frame[1, line], frame[2, line])
                filter_row(planes, third, settle, slow[line], delayed[line], filters, grey, highs[turn(line)])
                if every and line % every == 0:
                    wrong += outside(planes, unit)
            add_mirrored(grey, line, height, margin, block, rows)
        for part in range(2):
            any_of, to, weights = split(places[0], shares[0], y, y + 1, height, part)
            if any_of:
                for c in range(3):
                    if beside:
                        add_two(frame[y, :, c], frame[below, :, c], weights, bands[4 + c], to)
                    else:
                        add_two(frame[c, y], frame[c, below], weights, bands[4 + c], to)
                both = (highs[turn(y)], highs[turn(below)], delayed[y], delayed[below])
                add_across(both, weights, bands, to, wrap)
            any_of, to, weights = split(places[1], shares[1], y - 1, y, height - 1, part)
            if any_of:
                three = (highs[turn(above)], highs[turn(y)], highs[turn(below)])
                add_along(three, (delayed[above], delayed[y], delayed[below]), weights, bands, to)
    if wrap:
        end = height - 1
        weights = (shares[1, end, 0], shares[1, end, 1], kind(0), kind(0))
        three = (highs[turn(end)], highs[0], highs[0])
        add_along(three, (delayed[end], delayed[0], delayed[0]), weights, bands, places[1, end])
    for signal in range(7):
        between = 1 if signal < 2 else 0
        scale = unit if signal > 3 else 1.0
        for row in range(sums.shape[1]):
            for column in range(sums.shape[2]):
                total = dot(bands[signal, row], columns[between, column], starts[between, column])
                sums[signal, row, column] = scale * total
    thin_columns(rows, margins[1], image)
    return wrong


@jit
def turn(y: int) -> int:
    """Where the high-passed row of this number is kept."""
    return 1 + y % 3 if y else 0


@jit
def split(
    places: Array, shares: Array, one: int, two: int, end: int, part: int
) -> tuple[bool, Array, tuple[float, float, float, float]]:
    """Two rows may belong to different rows of fields: then each is added by itself, in one of two parts.

    Returns:
        Whether there is anything to add, the two rows of fields, and how much of each row goes to each.
    """
    kind = shares.dtype.type
    first, second = one >= 0, two < end
    same = first and second and places[one, 0] == places[two, 0] and places[one, 1] == places[two, 1]
    if part == 0:
        second = second and same
    else:
        first, second = False, second and not same
    a = b = c = d = kind(0)
    to = places[max(one, 0)]
    if first:
        a, b = shares[one, 0], shares[one, 1]
    if second:
        c, d = shares[two, 0], shares[two, 1]
        to = places[two]
    return first or second, to, (a, b, c, d)


@jit
def add_two(one: Array, two: Array, weights: tuple[float, float, float, float], bands: Array, to: Array) -> None:
    """Add two rows of a color to two of the bands `[R, W]`."""
    kind = bands.dtype.type
    a, b, c, d = weights
    above, below = bands[to[0]], bands[to[1]]
    for x in range(above.shape[0]):
        first, second = kind(one[x]), kind(two[x])
        above[x] += a * first + c * second
        below[x] += b * first + d * second


@jit
def add_across(
    rows: tuple[Array, Array, Array, Array],
    weights: tuple[float, float, float, float],
    bands: Array,
    to: Array,
    wrap: bool,
) -> None:
    """Add what neighbors in two rows make of each other: the positive part goes right, the negative part left.

    Args:
        rows: both as high-passed, and both as delayed.
    """
    h, i, late, later = rows
    a, b, c, d = weights
    none, width = h.dtype.type(0), h.shape[0]
    right, right_below, left, left_below = bands[1, to[0]], bands[1, to[1]], bands[0, to[0]], bands[0, to[1]]
    for x in range(width - 1):
        one = h[x + 1] * late[x] - h[x] * late[x + 1]
        two = i[x + 1] * later[x] - i[x] * later[x + 1]
        first, second = max(one, none), max(two, none)
        right[x] += a * first + c * second
        right_below[x] += b * first + d * second
        one, two = first - one, second - two
        left[x] += a * one + c * two
        left_below[x] += b * one + d * two
    if wrap:
        end = width - 1
        one = h[0] * late[end] - h[end] * late[0]
        two = i[0] * later[end] - i[end] * later[0]
        first, second = max(one, none), max(two, none)
        right[end] += a * first + c * second
        right_below[end] += b * first + d * second
        left[end] += a * (first - one) + c * (second - two)
        left_below[end] += b * (first - one) + d * (second - two)


@jit
def add_along(
    high: tuple[Array, Array, Array],
    delayed: tuple[Array, Array, Array],
    weights: tuple[float, float, float, float],
    bands: Array,
    to: Array,
) -> None:
    """Add what three rows make of each other, pair by pair: the positive part goes down, the negative one up."""
    h, i, j = high
    late, later, latest = delayed
    a, b, c, d = weights
    none = h.dtype.type(0)
    down, down_below, up, up_below = bands[2, to[0]], bands[2, to[1]], bands[3, to[0]], bands[3, to[1]]
    for x in range(h.shape[0]):
        one = i[x] * late[x] - h[x] * later[x]
        two = j[x] * later[x] - i[x] * latest[x]
        first, second = max(one, none), max(two, none)
        down[x] += a * first + c * second
        down_below[x] += b * first + d * second
        one, two = first - one, second - two
        up[x] += a * one + c * two
        up_below[x] += b * one + d * two


@jit
def dot(row: Array, weights: Array, start: int) -> float:
    """Sum of products with a part of a row, which may go on at the other border."""
    total = row.dtype.type(0)
    upto = min(weights.shape[0], row.shape[0] - start)
    for k in range(upto):
        total += row[start + k] * weights[k]
    for k in range(upto, weights.shape[0]):
        total += row[k - upto] * weights[k]
    return float(total)
