"""Whether each cell of floor is seen as one floor by both eyes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ndtorch.kernels.grey import grey_row
from ndtorch.kernels.strips import Array
from ndtorch.utils.jit import jit


@jit
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
    compare_cells(grey, rows, shift, first, wide, tall, alike, least, found, found.reshape(-1))


@jit
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
    soon: Array,
) -> None:
    """`match_cells` of rows that are grey already, `[2, R, width]`.

    Args:
        soon: numbers that are written next, which are asked for meanwhile.
    """
    _, bands, blocks = found.shape
    width = grey.shape[2]
    kind, n = found.dtype.type, wide - 1
    each = kind(1) / kind(n)
    pixels = grey.reshape(-1)
    # Of the rows of one band so far, in every column: long loops over neighbours. Blocks are summed up once a band.
    columns = np.zeros((2, 3, blocks * wide), found.dtype)
    sums_of_rows = columns.reshape(-1)
    sums = np.zeros((2, bands + 1, blocks, 3), found.dtype)
    seen = np.zeros((2, bands + 1, blocks), np.int64)
    for r in range(rows.size):
        band = max(0, bands - 1 - rows[r] // tall)
        for eye in range(2):
            away = -shift[r] if eye else shift[r]
            # Blocks that are in both rows: from the first that begins there up to the first that ends outside.
            begin = max(0, -((first[eye] + away) // wide))
            end = min(blocks, (width - 1 - n - first[eye] - away) // wide + 1)
            if begin >= end:
                continue
            at = np.uintp((eye * rows.size + r) * width + first[eye] + wide * begin)
            there = np.uintp(((1 - eye) * rows.size + r) * width + first[eye] + away + wide * begin)
            for k in range(begin, end):
                x = np.uintp((k - begin) * wide)
                # Changes add up to the difference of the last pixel and the first.
                mine = pixels[at + x + np.uintp(n)] - pixels[at + x]
                his = pixels[there + x + np.uintp(n)] - pixels[there + x]
                place = blocks - 1 - k if eye else k
                of_all = mine * each
                sums[eye, band, place, 0] -= of_all * his
                sums[eye, band, place, 1] -= of_all * mine
                sums[eye, band, place, 2] -= his * his * each
                seen[eye, band, place] += 1
            add_products(pixels, at, there, columns[eye], np.uintp(wide * begin), wide * (end - begin) - 1)
        if r + 1 == rows.size or band != max(0, bands - 1 - rows[r + 1] // tall):
            for eye in range(2):
                for k in range(blocks):
                    place = blocks - 1 - k if eye else k
                    add_up(columns[eye], np.uintp(wide * k), n, sums[eye, band, place])
            for k in range(columns.size):
                sums_of_rows[k] = 0
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


@jit
def add_products(pixels: Array, at: Any, there: Any, sums: Array, column: Any, size: int) -> None:
    """Products of so many changes from pixel to pixel in two rows, and their squares, are added to sums `[3, n]`."""
    for x in range(size):
        k = np.uintp(x)
        mine = pixels[at + k + np.uintp(1)] - pixels[at + k]
        his = pixels[there + k + np.uintp(1)] - pixels[there + k]
        sums[0, column + k] += mine * his
        sums[1, column + k] += mine * mine
        sums[2, column + k] += his * his


@jit
def add_up(columns: Array, start: Any, size: int, sums: Array) -> None:
    """Add so many columns of products `[3, ...]` to their sums `[3]`."""
    kind = sums.dtype.type
    product, square, other = kind(0), kind(0), kind(0)
    for x in range(size):
        k = start + np.uintp(x)
        product += columns[0, k]
        square += columns[1, k]
        other += columns[2, k]
    sums[0] += product
    sums[1] += square
    sums[2] += other
