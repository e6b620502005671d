"""Whether each cell of floor is seen as one floor by both eyes."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.kernels.strips import Array, grey_row


def match_cells(
    frames: tuple[Array, Array],
    beside: bool,
    tops: tuple[int, int],
    lefts: tuple[int, int],
    every: int,
    unit: float,
    count: int,
    width: int,
    rows: Array,
    shift: Array,
    first: tuple[int, int],
    wide: int,
    tall: int,
    alike: float,
    least: float,
    found: Array,
) -> None:
    """`floor_match` of one frame.

    Args:
        frames, beside, unit, count, tops, lefts, every: as of `cell_maxima`.
        width: columns of the rectangles, every so many of them.
        rows, shift, first, wide, tall, alike, least: of `MatchTables`.
        found: `[2, bands, blocks]`, nearest band and outermost block first.
    """
    _, bands, blocks = found.shape
    kind = found.dtype.type
    grey = np.empty((2, width), found.dtype)
    change = np.empty((2, width - 1), found.dtype)
    sums = np.zeros((2, bands + 1, blocks, 3), found.dtype)
    seen = np.zeros((2, bands + 1, blocks), np.int64)
    for r in range(rows.size):
        y = rows[r]
        band = max(0, bands - 1 - y // tall)
        for eye in range(2):
            grey_row(frames[eye], beside, tops[eye] + y, lefts[eye], every, unit, count, grey[eye])
            for x in range(width - 1):
                change[eye, x] = grey[eye, x + 1] - grey[eye, x]
        for eye in range(2):
            away = -shift[r] if eye else shift[r]
            for k in range(blocks):
                start = first[eye] + wide * k
                if start + away < 0 or start + away + wide - 1 > width - 1:
                    continue
                mine, his = kind(0), kind(0)
                product, square, other = kind(0), kind(0), kind(0)
                for x in range(start, start + wide - 1):
                    a, b = change[eye, x], change[1 - eye, x + away]
                    mine, his = mine + a, his + b
                    product, square, other = product + a * b, square + a * a, other + b * b
                place = blocks - 1 - k if eye else k
                n = kind(wide - 1)
                sums[eye, band, place, 0] += product - mine * his / n
                sums[eye, band, place, 1] += square - mine * mine / n
                sums[eye, band, place, 2] += other - his * his / n
                seen[eye, band, place] += 1
    step = 2 if rows.size < 2 else rows[1] - rows[0]
    for eye in range(2):
        for band in range(bands):
            for k in range(blocks):
                compared = seen[eye, band, k] + seen[eye, band + 1, k]
                product = sums[eye, band, k, 0] + sums[eye, band + 1, k, 0]
                square = sums[eye, band, k, 1] + sums[eye, band + 1, k, 1]
                other = sums[eye, band, k, 2] + sums[eye, band + 1, k, 2]
                enough = kind(least) * kind((wide - 1) * compared)
                same = product > kind(alike) * kind(math.sqrt(max(square, kind(0)) * max(other, kind(0))))
                verdict = kind(1) if same and min(square, other) > enough else kind(0)
                found[eye, band, k] = kind(-1) if 2 * step * compared < tall else verdict
