"""Compiled: the right rows searched for the surroundings of places of the left ones, see `search`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.navigation.stereo._kernels import Array, Frames, grey_row
from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float32]
Whole = npt.NDArray[np.int32]
Marks = npt.NDArray[np.bool_]

NEIGHBOURS = 2
"""Disparities this near to the best one do not count as another place."""

TINY = np.float32(1e-6)
"""A mean difference below this is as good as none."""

NEVER = np.float32(9.0)
"""More than two windows can differ: where one of them leaves its row."""

NEVER_BITS = NEVER.view(np.int32)


class SearchNumbers(NamedTuple):
    """`SearchParams` of a rig.

    Attributes:
        places: how many are ranged at most.
        band_start, band_end: columns among which `ahead` places are looked for first.
    """

    places: int
    level: int
    half: int
    min_disparity: int
    max_disparity: int
    ratio: float
    max_difference: float
    min_step: float
    agree: float
    spacing: int
    ahead: int
    band_start: int
    band_end: int


@jit
def grey_rows(frames: Frames, rows: Array, horizon: Array) -> float:
    """Grey of rows of both frames; returns the largest magnitude of a pixel, or NaN where there is one.

    Args:
        frames: `tops[0]` is the first row that is read of both.
        rows: becomes grey, `[2, R, W]`; horizon: becomes the middle rows, `[2, W]`.
    """
    most = np.float32(0)
    for eye in range(2):
        frame = frames.right if eye else frames.left
        for r in range(rows.shape[1]):
            row = rows[eye, r]
            grey_row(frame, frames.interleaved, frames.tops[0] + r, np.intp(0), np.intp(1), frames.scale, row)
            for x in range(row.shape[0]):
                size = abs(row[x])
                most = most if most >= size or most != most else size
        for x in range(horizon.shape[1]):
            horizon[eye, x] = rows[eye, rows.shape[1] // 2, x]
    return float(most)


@jit(exact=True)
def find_places(left: Floats, right: Floats, numbers: SearchNumbers, out: Floats) -> None:
    """Fill `out` `[3, n]` with left columns (0 where there is none), right columns and mean differences.

    Args:
        left, right: rows `[R, W]`, spoiled where they are leveled.
    """
    p, half = numbers, numbers.half
    rows, width = left.shape
    busy = np.zeros(width, np.bool_)
    for c in range(width):
        step = abs(left[rows // 2, min(c + 1, width - 1)] - left[rows // 2, max(c - 1, 0)]) / np.float32(2)
        busy[c] = (step if 0 < c < width - 1 else np.float32(0)) >= np.float32(p.min_step)
    if p.level:
        take_mean(left, p.level)
        take_mean(right, p.level)
    best, both = np.full(width, -1, np.int32), np.zeros(width, np.bool_)
    unlike, around = np.zeros(width, np.float32), np.full((3, width), NEVER, np.float32)
    compare_rows(left, right, p, busy, best, both, unlike, around)
    places, count = np.empty(width, np.int32), 0
    for c in range(width):
        if unlike[c] > 0 and both[c] and agreeing(best, both, c, half) >= p.agree * (2 * half + 1):
            places[count] = c
            count += 1
    for n in range(out.shape[1]):
        out[0, n], out[1, n], out[2, n] = 0, 0, 0
        c = -1
        if n < p.ahead:
            c = most_unlike(unlike, places[:count], p.band_start, p.band_end)
        if c < 0:
            c = most_unlike(unlike, places[:count], np.intp(0), width)
        if c >= 0:
            out[0, n], out[1, n], out[2, n] = c, c - (best[c] + shift(around[:, c])), around[1, c]
            for x in range(max(0, c - p.spacing), min(width, c + p.spacing + 1)):
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


@jit
def compare_rows(
    left: Floats,
    right: Floats,
    numbers: SearchNumbers,
    busy: Marks,
    best: Whole,
    both: Marks,
    unlike: Floats,
    around: Floats,
) -> None:
    """Every window of the left rows beside those of the right ones: where it fits best, in one pass over the columns.

    The differences of a column are followed from window to window and looked at while they are in the nearest cache:
    they are never all there at once.

    Args:
        left, right: `[R, W]`.
        busy: columns `[W]` for which `unlike` matters.
        best: becomes the disparity of every column, -1 where its window leaves the row, `[W]`.
        both: becomes whether the right row says the same, `[W]`.
        unlike: becomes by how much it is unlike all others, 0 where that is too little or not wanted, `[W]`.
        around: becomes the difference there and at its two neighbours, `[3, W]`.
    """
    rows, width = left.shape
    half, ratio = numbers.half, numbers.ratio
    depth, size = numbers.max_disparity + 1, 2 * half + 1
    # Turned round, so that the inner loops run over neighbours in memory.
    turned = np.zeros((rows, width + depth), np.float32)
    for r in range(rows):
        for x in range(width):
            turned[r, x] = right[r, width - 1 - x]
    new, total, share = np.zeros(depth, np.float32), np.zeros(depth, np.float32), np.float32(1 / (size * rows))
    windows, lines = np.zeros((size, depth), np.float32), np.empty((2, depth), np.float32)
    # Numbers of 0 or more are in the same order as their bits, and the least of whole numbers is found much faster.
    bits, behind = lines.view(np.int32), np.empty(depth, np.int32)
    elsewhere = np.empty(1, np.float32)
    second = elsewhere.view(np.int32)
    for k in range(depth):
        behind[k] = depth - k
    # Of every right column the least difference, the last column first, and of every left one the least beside it.
    back = np.full(width + depth, NEVER, np.float32)
    back_bits, beside = back.view(np.int32), np.full(width, NEVER, np.float32)
    for c in range(width):
        reach, n, m = min(depth, c + 1), min(depth, c - size + 2), c - half
        now, start = c & 1, width - 1 - c
        for r in range(rows - 1):
            differ(left[r, c], turned, r, start, reach, new)
        follow(left[rows - 1, c], turned[rows - 1], start, reach, new, windows[c % size], total, share, lines[now])
        if n <= 0:
            continue
        k = first_least(bits, now, n, behind)
        lower(bits, now, n, back_bits, width - 1 - m)
        found = lines[now, k]
        best[m], around[1, m], beside[m] = k, found, found
        if k > 0:
            around[0, m], beside[m] = lines[now, k - 1], min(found, lines[1 - now, k - 1])
        if k + 1 < n:
            around[2, m] = lines[now, k + 1]
        last = best[m - 1] + 1
        if 0 < last < n:
            beside[m - 1] = min(beside[m - 1], lines[now, last])
        if k >= numbers.min_disparity and found < np.float32(numbers.max_difference) and busy[m]:
            second[0] = min(least_of(bits, now, np.intp(0), k - NEIGHBOURS), least_of(bits, now, k + NEIGHBOURS + 1, n))
            over = found / max(elsewhere[0], TINY)
            unlike[m] = 1 - over if over < np.float32(ratio) and elsewhere[0] < NEVER else 0
    for c in range(width):
        both[c] = best[c] >= 0 and beside[c] <= back[width - 1 - c + best[c]]


@jit
def differ(here: float, turned: Floats, r: int, start: int, reach: int, new: Floats) -> None:
    """Differences of one pixel from many of row `r`, which are added to those of the rows before."""
    if r == 0:
        for k in range(reach):
            new[k] = abs(here - turned[0, np.uintp(start + k)])
    else:
        for k in range(reach):
            new[k] += abs(here - turned[r, np.uintp(start + k)])


@jit
def follow(
    here: float,
    turned: Floats,
    start: int,
    reach: int,
    new: Floats,
    oldest: Floats,
    total: Floats,
    share: float,
    line: Floats,
) -> None:
    """Windows move on by a column: their sums lose the oldest one, which becomes the new one, and gain that.

    The last row is compared on the way; `new` holds what the others add.
    """
    for k in range(reach):
        fresh = new[k] + abs(here - turned[np.uintp(start + k)])
        value = total[k] - oldest[k] + fresh
        oldest[k] = fresh
        total[k] = value
        line[k] = value * share


@jit
def first_least(bits: Whole, now: int, n: int, behind: Whole) -> int:
    """Where a line is least, the first such place; `behind` counts down to 1."""
    least, at, none = bits[now, 0], np.int32(0), np.int32(0)
    for k in range(n):
        least = min(least, bits[now, k])
    for k in range(n):
        at = max(at, behind[k] if bits[now, k] == least else none)
    place: int = behind[0] - at
    return place


@jit
def lower(bits: Whole, now: int, n: int, back: Whole, start: int) -> None:
    """The lower of each of two numbers, from `start` on."""
    for k in range(n):
        back[np.uintp(start + k)] = min(back[np.uintp(start + k)], bits[now, k])


@jit(exact=True)
def least_of(bits: Whole, now: int, start: int, end: int) -> np.int32:
    """The least of some numbers of a line; that of `NEVER` where there are none."""
    least = NEVER_BITS
    for k in range(start, end):
        least = min(least, bits[now, np.uintp(k)])
    return least
