"""What `ndtorch.navigation.near_things.compared` does in NumPy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ndtorch.kernels.compare_rows import NEVER, Floats, Whole, first_least, follow, least_of
from ndtorch.utils.jit import jit

Columns = npt.NDArray[np.int64]


@jit
def near_rows(
    left: Floats,
    right: Floats,
    first: int,
    high: int,
    half: int,
    neighbors: int,
    best: Columns,
    back: Columns,
    costs: Floats,
) -> None:
    """Fill in the best disparity of every left column, that of its partner, and the costs.

    Args:
        left, right: rows `[W]`.
        first, high: disparities from and up to, without the last.
        half: columns of a window to either side.
        neighbors: disparities this near to the best one are not elsewhere.
        best: of every left column, less `first`, `[W]`.
        back: that of the right column which it leads to, seen from the right, `[W]`.
        costs: of the best one, and the least one elsewhere, `[2, W]`.
    """
    width, size, depth = len(left), 2 * half + 1, high - first
    # Lines of one column each, by the right end of its window; see `compare_rows`, which does not keep them.
    cost, turned = np.empty((width, depth), np.float32), np.zeros((1, width + high), np.float32)
    for x in range(width):
        turned[0, x] = right[width - 1 - x]
    none, total, windows = np.zeros(depth, np.float32), np.zeros(depth, np.float32), np.zeros((size, depth), np.float32)
    bits, behind, partner = cost.view(np.int32), np.empty(depth, np.int32), np.zeros(width + high, np.int32)
    for k in range(depth):
        behind[k] = depth - k
    lowest = np.empty(width + high, np.float32)
    for x in range(width + high):
        lowest[x] = NEVER
    lowest_bits = lowest.view(np.int32)
    elsewhere = np.empty(1, np.float32)
    second = elsewhere.view(np.int32)
    for c in range(width):
        best[c], costs[0, c], costs[1, c] = 0, NEVER, NEVER
    for c in range(first, width):
        reach, n, m = min(depth, c - first + 1), min(depth, c - first - size + 2), c - half
        start, share = width - 1 - c + first, np.float32(1 / size)
        follow(left[c], turned, 0, start, reach, none, windows, c % size, total, share, cost, c)
        if n > 0:
            nothing_below(cost, c, n)
            k = first_least(bits, c, n, behind)
            partners(bits, c, n, lowest_bits, partner, width - 1 - m + first, behind)
            second[0] = min(least_of(bits, c, 0, k - neighbors), least_of(bits, c, k + neighbors + 1, n))
            best[m], costs[0, m], costs[1, m] = k, cost[c, k], elsewhere[0]
    for c in range(width):
        x = min(max(c - first - best[c], 0), width - 1)
        back[c] = depth - partner[width - 1 - x] if partner[width - 1 - x] else 0


@jit
def nothing_below(cost: Floats, c: int, n: int) -> None:
    """What was added and taken again may end a little below 0."""
    for k in range(n):
        cost[c, k] = cost[c, k] if cost[c, k] > 0 else np.float32(0)


@jit
def partners(bits: Whole, now: int, n: int, lowest: Whole, partner: Whole, start: int, behind: Whole) -> None:
    """Of every right column the lowest number so far, and the first place, counted from behind, that has it."""
    for k in range(n):
        at = np.uintp(start + k)
        partner[at] = behind[k] if bits[now, k] < lowest[at] else partner[at]
        lowest[at] = min(lowest[at], bits[now, k])
