"""Whether each cell of floor is seen as one floor by both eyes."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.kernels.grey import grey_row
from ndtorch.kernels.inner import apart, inner
from ndtorch.kernels.strips import Array


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
    grey = np.empty((2, rows.size, width), found.dtype)
    for eye in range(2):
        for r in range(rows.size):
            grey_row(frames[eye], beside, tops[eye] + rows[r], lefts[eye], every, unit, count, grey[eye, r])
    compare_cells(grey, rows, shift, first, wide, tall, alike, least, found)


@inner
def compare_cells(
    grey: Array,
    rows: Array,
    shift: Array,
    first: tuple[int, int],
    wide: int,
    tall: int,
    alike: float,
    least: float,
    found: Array,
) -> None:
    """`match_cells` of rows that are grey already, `[2, R, width]`."""
    _, bands, blocks = found.shape
    width = grey.shape[2]
    kind, n = found.dtype.type, wide - 1
    each = kind(1) / kind(n)
    change = np.empty((2, width - 1), found.dtype)
    # Of the rows of one band so far, in every column: long loops over neighbours. Blocks are summed up once a band.
    columns = np.zeros((2, 3, blocks * wide), found.dtype)
    sums = np.zeros((2, bands + 1, blocks, 3), found.dtype)
    seen = np.zeros((2, bands + 1, blocks), np.int64)
    for r in range(rows.size):
        y = rows[r]
        band = max(0, bands - 1 - y // tall)
        for eye in range(2):
            line = grey[eye, r]
            for x in range(width - 1):
                change[eye, x] = line[x + 1] - line[x]
        for eye in range(2):
            away = -shift[r] if eye else shift[r]
            begin, end = blocks, 0
            for k in range(blocks):
                start = first[eye] + wide * k
                if start + away < 0 or start + away + n > width - 1:
                    continue
                begin, end = min(begin, k), k + 1
                # Changes add up to the difference of the last pixel and the first.
                mine = grey[eye, r, start + n] - grey[eye, r, start]
                his = grey[1 - eye, r, start + away + n] - grey[1 - eye, r, start + away]
                place = blocks - 1 - k if eye else k
                of_all = mine * each
                total = sums[eye, band, place]
                total[0] -= of_all * his
                total[1] -= of_all * mine
                total[2] -= his * his * each
                seen[eye, band, place] += 1
            if begin < end:
                start, length = first[eye] + wide * begin, wide * (end - begin) - 1
                ours, theirs = (
                    change[eye, start : start + length],
                    change[1 - eye, start + away : start + away + length],
                )
                column = wide * begin
                end = column + length
                add_products(
                    ours, theirs, columns[eye, 0, column:end], columns[eye, 1, column:end], columns[eye, 2, column:end]
                )
        if r + 1 == rows.size or band != max(0, bands - 1 - rows[r + 1] // tall):
            for eye in range(2):
                for k in range(blocks):
                    product, square, other = kind(0), kind(0), kind(0)
                    for x in range(wide * k, wide * k + n):
                        product += columns[eye, 0, x]
                        square += columns[eye, 1, x]
                        other += columns[eye, 2, x]
                    place = blocks - 1 - k if eye else k
                    sums[eye, band, place, 0] += product
                    sums[eye, band, place, 1] += square
                    sums[eye, band, place, 2] += other
            for eye in range(2):
                for k in range(3):
                    for x in range(blocks * wide):
                        columns[eye, k, x] = 0
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


@apart
def add_products(one: Array, other: Array, products: Array, squares: Array, others: Array) -> None:
    """Add the products of every two numbers, and their squares, to their sums."""
    for x in range(products.shape[0]):
        mine, his = one[x], other[x]
        products[x] += mine * his
        squares[x] += mine * mine
        others[x] += his * his
