"""What `ndtorch.navigation.near_things.compared` does in NumPy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]
Whole = npt.NDArray[np.int64]

NEVER = np.float32(9.0)
"""More than two windows can differ: where one of them leaves its row."""


def near_rows(
    left: Floats,
    right: Floats,
    first: int,
    high: int,
    half: int,
    neighbors: int,
    best: Whole,
    back: Whole,
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
    cost = np.full((depth, width), NEVER, np.float32)
    for k in range(depth):
        d, total, line = k + first, 0.0, cost[k]
        for c in range(d, width):
            total += abs(left[c] - right[c - d])
            if c >= d + size:
                total -= abs(left[c - size] - right[c - size - d])
            if c >= d + size - 1:
                line[c - half] = max(np.float32(total / size), np.float32(0))
    costs[:] = NEVER
    best[:] = 0
    for k in range(depth):
        for c in range(width):
            if cost[k, c] < costs[0, c]:
                costs[0, c], best[c] = cost[k, c], k
    for k in range(depth):
        for c in range(width):
            if abs(k - best[c]) > neighbors:
                costs[1, c] = min(costs[1, c], cost[k, c])
    for c in range(width):
        partner = min(max(c - first - best[c], 0), width - 1)
        least, back[c] = NEVER, 0
        for k in range(depth):
            if partner + first + k < width and cost[k, partner + first + k] < least:
                least, back[c] = cost[k, partner + first + k], k
