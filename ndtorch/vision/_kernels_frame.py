"""Kernels of a frame: the ten sums of the whole field, and of many receptive fields, in one pass over the pixels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import (
    Array,
    add_to_two,
    add_weighted,
    color_planes,
    correlate,
    filter_row,
    outside,
    thin_columns,
)

BAND = 4
"""Rows of pixels that all frames go through before the next ones: so many rows of the states stay in the cache."""


class PassConstants(NamedTuple):
    """What a pass over frames needs to know.

    Attributes:
        a_high, a_low: shares of the filters of the motion detectors.
        wrap: correlate across the border as well.
        block: rows that become one, a power of two.
        margins: mirrored rows above and below, and columns at both sides.
        every: how many rows apart pixels are checked to be in 0..1; 0: none are.
    """

    a_high: float
    a_low: float
    wrap: bool
    block: int
    margins: tuple[int, int]
    every: int


class FieldTables(NamedTuple):
    """Which pixels belong to which receptive fields.

    Attributes:
        columns: weights of pixels, and of what lies between them, in each column of fields, `[2, C, K]`.
        starts: the first of those K pixels, `[2, C]`; they may go on at the other border.
        places: the two rows of fields to which a row of pixels belongs, and what lies below it, `[2, H, 2]`.
        shares: how much, `[2, H, 2]`.
    """

    columns: Array
    starts: Array
    places: Array
    shares: Array


@jit
def front_end(
    frames: Array,
    beside: bool,
    unit: float,
    settle: bool,
    slow: Array,
    delayed: Array,
    constants: PassConstants,
    images: Array,
    sums: Array,
) -> None:
    """`front_step` and the first steps of `OrientedDoG.sums`, row by row, so that a row is read once.

    The states, which are larger than a cache, are read and written once for all frames.

    Args:
        frames: `[T, 3, H, W]`, or `[T, H, W, 3]` where colors lie `beside` each other.
        unit: factor that scales it to 0..1.
        settle: the state before is that of filters settled on the first frame, whatever is given.
        slow, delayed: `MotionState` before, `[H, W]`; they become that after the last frame.
        images: become the grey images with their margins, rows and columns thinned as by `thin_rows`, `[T, h, w]`.
        sums: across, its magnitude, along, its magnitude, red, green, blue, and how many pixels of those looked at
            are not in 0..1; `[T, 8]` float64.
    """
    a_high, a_low, wrap, block, margins, every = constants
    (times, kept, _), (height, width), margin = images.shape, slow.shape, margins[0]
    kind = slow.dtype.type
    third, shares = kind(unit / 3), (a_high, a_low)
    greys, highs = np.empty((BAND, width), slow.dtype), np.empty((BAND, width), slow.dtype)
    rows = np.zeros((times, kept, width), slow.dtype)
    # The first row is kept for where the torus closes, the last one of a band for the next.
    first, last = np.empty((times, 2, width), slow.dtype), np.empty((times, 2, width), slow.dtype)
    # Four rows between the middles of two blocks are added at once, where none is mirrored in a margin. Such rows
    # begin two rows into a block, and so do bands.
    inner_from, inner_to = (2 * margin + 2) // 4 * 4 + 2 - margin, (height - 3) // 4 * 4 + 2 - margin
    sums[:] = 0
    unused, pixels = np.zeros(2), frames.reshape(times, -1)
    flat = (slow.reshape(-1), delayed.reshape(-1), greys.reshape(-1), highs.reshape(-1))
    colors = np.empty((3, BAND * width if beside else 0), frames.dtype)
    for begin in range(-((margin + 2) % 4), height, BAND):
        top, bottom = max(begin, 0), min(begin + BAND, height)
        count = bottom - top
        high, grey, late = highs[:count], greys[:count], delayed[top:bottom]
        begins, ends = top * width, bottom * width
        states, out = (flat[0][begins:ends], flat[1][begins:ends]), (flat[2][: ends - begins], flat[3][: ends - begins])
        for t in range(times):
            total, settled = sums[t], settle and t == 0
            planes = color_planes(pixels[t], beside, begins, ends, colors)
            r, g, b = filter_row(planes, third, settled, *states, shares, *out)
            for y in range(top, bottom):
                if every and y % every == 0:
                    total[7] += outside(planes, (y - top) * width, width, unit)
            total[4], total[5], total[6] = total[4] + r, total[5] + g, total[6] + b
            ahead, along, over = total[0:2], total[2:4], total[2:4]
            if top == 0:
                keep(high[0], late[0], first[t])
                keep(high[0], late[0], last[t])
                over = unused
            correlate(high[:1], late[:1], last[t, :1], last[t, 1:], (ahead, over))
            correlate(high[1:], late[1:], high[:-1], late[:-1], (ahead, along))
            keep(high[count - 1], late[count - 1], last[t])
            if wrap:
                for y in range(count):
                    signed = high[y, 0] * late[y, width - 1] - high[y, width - 1] * late[y, 0]
                    total[0], total[1] = total[0] + signed, total[1] + abs(signed)
            if block == 4 and inner_from <= top < inner_to:
                here = (top + margin) // 4
                add_four(grey, rows[t, here], rows[t, here + 1])
            else:
                for y in range(count):
                    add_mirrored(grey[y], top + y, height, margin, block, rows[t])
    for t in range(times):
        total = sums[t]
        if wrap:
            correlate(first[t, :1], first[t, 1:], last[t, :1], last[t, 1:], (unused, total[2:4]))
        for color in range(4, 7):
            total[color] *= unit
        thin_columns(rows[t], margins[1], images[t])


@jit
def keep(high: Array, late: Array, both: Array) -> None:
    """Keep a row as high-passed and as delayed, `[2, W]`."""
    for x in range(high.shape[0]):
        both[0, x], both[1, x] = high[x], late[x]


@jit
def add_four(greys: Array, here: Array, there: Array) -> None:
    """`add_thinned` of four rows at once: the last two of a block and the first two of the next."""
    kind = here.dtype.type
    least, less, more, most = kind(0.125), kind(0.375), kind(0.625), kind(0.875)
    one, two, three, four = greys[0], greys[1], greys[2], greys[3]
    for x in range(here.shape[0]):
        here[x] += most * one[x] + more * two[x] + less * three[x] + least * four[x]
        there[x] += least * one[x] + less * two[x] + more * three[x] + most * four[x]


@jit
def add_thinned(row: Array, place: int, block: int, rows: Array) -> None:
    """Add the row at `place` to the two blocks whose middles it lies between: a triangle of weights, as of
    `thin_rows`."""
    half_rows = 2 * place - (block - 1)
    above = half_rows // (2 * block)
    share = (half_rows - 2 * block * above) / (2 * block)
    here, there = above % rows.shape[0], (above + 1) % rows.shape[0]
    kind = rows.dtype.type
    if share > 0 and here != there:
        add_to_two(row, (kind(1 - share), kind(share)), rows[here], rows[there])
    else:
        add_weighted(row, kind(1), rows[here])


@jit
def add_mirrored(row: Array, y: int, height: int, margin: int, block: int, rows: Array) -> None:
    """Add a row of the image, and where it is mirrored in the margins, to what its blocks become."""
    add_thinned(row, y + margin, block, rows)
    if 0 < y <= margin:
        add_thinned(row, margin - y, block, rows)
    if 0 < height - 1 - y <= margin:
        add_thinned(row, margin + 2 * (height - 1) - y, block, rows)


@jit
def local_sums(
    frame: Array,
    beside: bool,
    unit: float,
    settle: bool,
    slow: Array,
    delayed: Array,
    constants: PassConstants,
    image: Array,
    tables: FieldTables,
    sums: Array,
) -> int:
    """Motion and color in every field of `LocalFeatures`.

    Args:
        frame, beside, unit, settle, slow, delayed, constants, image: of `front_end`, for one frame.
        sums: left, right, down, up, red, green, blue, `[7, R, C]`; they become those of this frame.

    Returns:
        How many pixels of those looked at are not in 0..1.
    """
    a_high, a_low, wrap, block, margins, every = constants
    columns, starts, places, shares = tables
    height, width = slow.shape
    kind = slow.dtype.type
    third, filters = kind(unit / 3), (a_high, a_low)
    grey, margin = np.empty(width, slow.dtype), margins[0]
    # The first row is kept for where the torus closes; the others take turns.
    highs = np.empty((4, width), slow.dtype)
    rows, wrong = np.zeros((image.shape[0], width), slow.dtype), 0
    pixels, colors = frame.reshape(-1), np.empty((2, 3, width if beside else 0), frame.dtype)
    # Rows first: what belongs to a row of fields stays in the cache while it grows. Two rows at a time, for each is
    # added to two rows of fields, which are read and written half as often so.
    bands = np.zeros((7, sums.shape[1], width), slow.dtype)
    for y in range(0, height, 2):
        below, above = min(y + 1, height - 1), max(y - 1, 0)
        one = color_planes(pixels, beside, y * width, (y + 1) * width, colors[0])
        two = color_planes(pixels, beside, below * width, (below + 1) * width, colors[1])
        for line in range(y, below + 1):
            planes = one if line == y else two
            filter_row(planes, third, settle, slow[line], delayed[line], filters, grey, highs[turn(line)])
            if every and line % every == 0:
                wrong += outside(planes, 0, width, unit)
            add_mirrored(grey, line, height, margin, block, rows)
        for part in range(2):
            any_of, to, weights = split(places[0], shares[0], y, y + 1, height, part)
            if any_of:
                for c in range(3):
                    add_two(one[c], two[c], weights, bands[4 + c], to)
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
