"""One pass over frames: grey, color sums, both filters of the motion detectors, their four sums, thinned images."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array, add_to_two, add_weighted, correlate, filter_row, outside
from ndtorch.kernels.thinned_columns import thin_columns
from ndtorch.utils.jit import jit

BAND = 4
"""Rows of pixels that all frames go through before the next ones: so many rows of the states stay in the cache."""


@jit
def front_end(
    frames: Array,
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
        a_high, a_low: shares of the filters.
        wrap: correlate across the border as well.
        block: rows that become one, a power of two.
        margins: mirrored rows above and below, and columns at both sides.
        every: how many rows apart pixels are looked at whether they are in 0..1; 0: none are.
        images: become the grey images with their margins, rows and columns thinned as by `thin_rows`, `[T, h, w]`.
        sums: across, its magnitude, along, its magnitude, red, green, blue, and how many pixels of those looked at
            are not in 0..1; `[T, 8]` float64.
    """
    (times, kept, _), (height, width), margin = images.shape, slow.shape, margins[0]
    kind = slow.dtype.type
    third, shares, lag = kind(unit / 3), (a_high, a_low), np.uintp(min(width, 1))
    greys, highs = np.empty((BAND, width), slow.dtype), np.empty((BAND, width), slow.dtype)
    rows = np.zeros((times, kept, width), slow.dtype)
    # The first row is kept for where the torus closes, the last one of a band for the next.
    first, last = np.empty((times, 2, width), slow.dtype), np.empty((times, 2, width), slow.dtype)
    # Four rows between the middles of two blocks are added at once, where none is mirrored in a margin. Such rows
    # begin two rows into a block, and so do bands.
    inner_from, inner_to = (2 * margin + 2) // 4 * 4 + 2 - margin, (height - 3) // 4 * 4 + 2 - margin
    sums[:] = 0
    unused, plane, pixels = np.zeros(2), height * width, frames.reshape(times, -1)
    flat = (slow.reshape(-1), delayed.reshape(-1), greys.reshape(-1), highs.reshape(-1))
    for begin in range(-((margin + 2) % 4), height, BAND):
        top, bottom = max(begin, 0), min(begin + BAND, height)
        count = bottom - top
        high, grey, late = highs[:count], greys[:count], delayed[top:bottom]
        begins, ends = top * width, bottom * width
        states, out = (flat[0][begins:ends], flat[1][begins:ends]), (flat[2][: ends - begins], flat[3][: ends - begins])
        for t in range(times):
            total, settled = sums[t], settle and t == 0
            if beside:
                some = pixels[t, 3 * begins : 3 * ends]
                r, g, b = filter_row((some[::3], some[1::3], some[2::3]), third, settled, *states, shares, *out)
            else:
                green, blue = plane + begins, 2 * plane + begins
                planes = (pixels[t, begins:ends], pixels[t, green : plane + ends], pixels[t, blue : 2 * plane + ends])
                r, g, b = filter_row(planes, third, settled, *states, shares, *out)
            for y in range(top, bottom):
                if every and y % every == 0:
                    if beside:
                        total[7] += outside((frames[t, y, :, 0], frames[t, y, :, 1], frames[t, y, :, 2]), unit)
                    else:
                        total[7] += outside((frames[t, 0, y], frames[t, 1, y], frames[t, 2, y]), unit)
            total[4], total[5], total[6] = total[4] + r, total[5] + g, total[6] + b
            ahead, along, over = total[0:2], total[2:4], total[2:4]
            if top == 0:
                keep(high[0], late[0], first[t])
                keep(high[0], late[0], last[t])
                over = unused
            correlate(high[:1], late[:1], last[t, :1], last[t, 1:], lag, (ahead, over))
            correlate(high[1:], late[1:], high[:-1], late[:-1], lag, (ahead, along))
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
            correlate(first[t, :1], first[t, 1:], last[t, :1], last[t, 1:], lag, (unused, total[2:4]))
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
