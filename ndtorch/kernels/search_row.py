"""Where the right rows show the surroundings of a place of the left ones, see `ndtorch.navigation.row_search`."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.compare_rows import NEVER, Floats, Marks, Whole, compare_rows
from ndtorch.utils.jit import jit

Numbers = tuple[int, int, int, int, float, float, float, float, int, int]


@jit
def search_row(left: Floats, right: Floats, params: Numbers, band: tuple[int, int], out: Floats) -> None:
    """`find_places` of one pair of rows."""
    find_places(left, right, params, band, out)


@jit(exact=True)
def find_places(left: Floats, right: Floats, params: Numbers, band: tuple[int, int], out: Floats) -> None:
    """Fill `out` `[3, n]` with left columns (0 where there is none), right columns and mean differences.

    Args:
        left, right: rows `[R, W]`, spoiled where they are leveled.
        params: `level`, `half`, least and largest disparity, `ratio`, `max_difference`, `min_step`, `agree`, `spacing`
            and `ahead`, see `SearchParams`.
        band: columns, from and up to, in which the first `ahead` places lie, as far as there are any.
    """
    level, half, low, high, ratio, most, least_step, agree, spacing, ahead = params
    rows, width = left.shape
    busy = np.zeros(width, np.bool_)
    for c in range(width):
        step = abs(left[rows // 2, min(c + 1, width - 1)] - left[rows // 2, max(c - 1, 0)]) / np.float32(2)
        busy[c] = (step if 0 < c < width - 1 else np.float32(0)) >= np.float32(least_step)
    if level:
        take_mean(left, level)
        take_mean(right, level)
    best, both = np.full(width, -1, np.int32), np.zeros(width, np.bool_)
    unlike, around = np.zeros(width, np.float32), np.full((3, width), NEVER, np.float32)
    compare_rows(left, right, half, high, ratio, (low, most, busy), best, both, unlike, around)
    places, count = np.empty(width, np.int32), 0
    for c in range(width):
        if unlike[c] > 0 and both[c] and agreeing(best, both, c, half) >= agree * (2 * half + 1):
            places[count] = c
            count += 1
    for n in range(out.shape[1]):
        out[0, n], out[1, n], out[2, n] = 0, 0, 0
        c = -1
        if n < ahead:
            c = most_unlike(unlike, places[:count], band[0], band[1])
        if c < 0:
            c = most_unlike(unlike, places[:count], 0, width)
        if c >= 0:
            out[0, n], out[1, n], out[2, n] = c, c - (best[c] + shift(around[:, c])), around[1, c]
            for x in range(max(0, c - spacing), min(width, c + spacing + 1)):
                unlike[x] = 0


@jit
def take_mean(rows: Floats, reach: int) -> None:
    """Take from every pixel the mean of those of its row within `reach`."""
    width = rows.shape[1]
    row = np.empty(width, np.float32)
    for r in range(rows.shape[0]):
        for x in range(width):
            row[x] = rows[r, x]
        total, count = 0.0, min(reach, width)
        for x in range(count):
            total += row[x]
        for x in range(width):
            if x + reach < width:
                total, count = total + row[x + reach], count + 1
            if x - reach > 0:
                total, count = total - row[x - reach - 1], count - 1
            rows[r, x] = row[x] - np.float32(total / count)


@jit(exact=True)
def agreeing(best: Whole, both: Marks, column: int, reach: int) -> int:
    """How many columns within reach were found where one surface through all of them could be."""
    count = 0
    for x in range(max(0, column - reach), min(len(best), column + reach + 1)):
        if both[x] and 2 * abs(best[x] - best[column]) <= 2 + abs(x - column):
            count += 1
    return count


@jit(exact=True)
def most_unlike(unlike: Floats, places: Whole, start: int, end: int) -> int:
    """The place from `start` up to `end` that is most unlike all others, the first of such; -1 where there is none."""
    found, highest = -1, np.float32(0)
    for k in range(places.shape[0]):
        c = places[k]
        if start <= c < end and unlike[c] > highest:
            found, highest = c, unlike[c]
    return found


@jit(exact=True)
def shift(around: Floats) -> float:
    """Where between its neighbours the smallest of three is, by a parabola."""
    before, here, after = around[0], around[1], around[2]
    curve = before + after - 2 * here
    if before >= NEVER or after >= NEVER or curve <= 1e-9:
        return 0.0
    place: float = min(max((before - after) / (2 * curve), -0.5), 0.5)
    return place
