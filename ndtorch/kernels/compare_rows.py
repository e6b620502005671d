"""Every window of the left rows beside those of the right ones: where it fits best, in one pass over the columns."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float32]
Whole = npt.NDArray[np.int32]
Marks = npt.NDArray[np.bool_]

NEIGHBOURS = 2
"""As in `ndtorch.navigation.row_search`."""

TINY = np.float32(1e-6)
"""As in `ndtorch.navigation.row_search`."""

NEVER = np.float32(9.0)
"""More than two windows can differ: where one of them leaves its row."""

NEVER_BITS = NEVER.view(np.int32)


@jit
def compare_rows(
    left: Floats,
    right: Floats,
    half: int,
    high: int,
    ratio: float,
    wanted: tuple[int, float, Marks],
    best: Whole,
    both: Marks,
    unlike: Floats,
    around: Floats,
) -> None:
    """`differences` and `winners` of `ndtorch.navigation.row_search`, of one pair of rows.

    The differences of a column are followed from window to window and looked at while they are in the nearest cache:
    they are never all there at once.

    Args:
        left, right: `[R, W]`.
        half, high: pixels to either side of a place, and the largest disparity.
        ratio: share of the best match elsewhere that one may differ by.
        wanted: least disparity, largest difference, and columns `[W]` for which `unlike` matters.
        best: becomes the disparity of every column, -1 where its window leaves the row, `[W]`.
        both: becomes whether the right row says the same, `[W]`.
        unlike: becomes by how much it is unlike all others, 0 where that is too little or not wanted, `[W]`.
        around: becomes the difference there and at its two neighbours, `[3, W]`.
    """
    rows, width = left.shape
    depth, size = high + 1, 2 * half + 1
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
    least_disparity, most, columns = wanted
    for c in range(width):
        reach, n, m = min(depth, c + 1), min(depth, c - size + 2), c - half
        now, start = c & 1, width - 1 - c
        for r in range(rows - 1):
            differ(left[r, c], turned, r, start, reach, new)
        follow(left[rows - 1, c], turned, rows - 1, start, reach, new, windows, c % size, total, share, lines, now)
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
        if k >= least_disparity and found < np.float32(most) and columns[m]:
            second[0] = min(least_of(bits, now, 0, k - NEIGHBOURS), least_of(bits, now, k + NEIGHBOURS + 1, n))
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
    r: int,
    start: int,
    reach: int,
    new: Floats,
    windows: Floats,
    slot: int,
    total: Floats,
    share: float,
    lines: Floats,
    now: int,
) -> None:
    """Windows move on by a column: their sums lose the old one in a slot, which becomes the new one, and gain that.

    The last row is compared on the way; `new` holds what the others add.
    """
    for k in range(reach):
        fresh = new[k] + abs(here - turned[r, np.uintp(start + k)])
        value = total[k] - windows[slot, k] + fresh
        windows[slot, k] = fresh
        total[k] = value
        lines[now, k] = value * share


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
