"""Where the right row shows the surroundings of a place of the left row."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]

NEIGHBOURS = 2
"""Disparities this near to the best one do not count as elsewhere."""


def search_row(
    left: Floats,
    right: Floats,
    half: int,
    low: int,
    high: int,
    ratio: float,
    most: float,
    least_step: float,
    spacing: int,
    out: Floats,
) -> None:
    """Fill `out` `[3, n]` with left columns (0 where there is none), right columns and mean differences.

    Args:
        left, right: rows `[W]`.
        half, low, high, ratio, most, least_step, spacing: see `SearchParams`.
    """
    width, depth, size = len(left), high - low, 2 * half + 1
    never = np.float32(9.0)
    cost = np.full((width, depth), never, np.float32)
    for k in range(depth):
        d = low + k
        # A running sum: the window at column c compares left[c - half .. c + half] with the same less d.
        total = 0.0
        for c in range(d, width):
            total += abs(left[c] - right[c - d])
            if c - d >= size:
                total -= abs(left[c - size] - right[c - size - d])
            if c - d >= size - 1:
                cost[c - half, k] = total / size
    best = np.full(width, -1, np.int32)
    value = np.full(width, never, np.float32)
    for c in range(half, width - half):
        for k in range(depth):
            if cost[c, k] < value[c]:
                value[c], best[c] = cost[c, k], k
    back = np.full(width, -1, np.int32)
    for x in range(half, width - half):
        least = never
        for k in range(min(depth, width - low - x)):
            if cost[x + low + k, k] < least:
                least, back[x] = cost[x + low + k, k], k
    step = np.zeros(width, np.float32)
    for c in range(half, width - half):
        k = best[c]
        if k < 0 or value[c] >= most:
            continue
        size_of_step = abs(left[c] - left[c - 1])
        if size_of_step < least_step or abs(back[c - low - k] - k) > 1:
            continue
        unlike = True
        limit = value[c] / ratio
        for other in range(depth):
            if cost[c, other] <= limit and abs(other - k) > NEIGHBOURS:
                unlike = False
                break
        if unlike:
            step[c] = size_of_step
    for n in range(out.shape[1]):
        c = int(step.argmax())
        if step[c] <= 0:
            break
        k = best[c]
        shift = 0.0
        if 0 < k < depth - 1 and cost[c, k - 1] < never and cost[c, k + 1] < never:
            curve = cost[c, k - 1] + cost[c, k + 1] - 2 * cost[c, k]
            if curve > 1e-9:
                shift = min(max((cost[c, k - 1] - cost[c, k + 1]) / (2 * curve), -0.5), 0.5)
        out[0, n], out[1, n], out[2, n] = c, c - (low + k + shift), value[c]
        step[max(0, c - spacing) : c + spacing + 1] = 0
