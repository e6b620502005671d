"""Where the right rows show the surroundings of a place of the left ones, see `ndtorch.navigation.row_search`."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from ndtorch.kernels.load import FAST

Floats = npt.NDArray[np.float32]
Whole = npt.NDArray[np.int32]

NEIGHBOURS = 2
"""As in `ndtorch.navigation.row_search`."""

NEVER = np.float32(9.0)
"""More than two windows can differ: where one of them leaves its row."""


def search_row(
    left: Floats,
    right: Floats,
    level: int,
    half: int,
    low: int,
    high: int,
    ratio: float,
    most: float,
    least_step: float,
    agree: float,
    spacing: int,
    ahead: int,
    band: tuple[int, int],
    out: Floats,
) -> None:
    """Fill `out` `[3, n]` with left columns (0 where there is none), right columns and mean differences.

    Args:
        left, right: rows `[R, W]`, spoiled where they are leveled.
        level, half, low, high, ratio, most, least_step, agree, spacing, ahead: see `SearchParams`.
        band: columns, from and up to, in which the first `ahead` places lie, as far as there are any.
    """
    width = left.shape[1]
    steps = np.zeros(width, np.float32)
    for c in range(1, width - 1):
        steps[c] = abs(left[left.shape[0] // 2, c + 1] - left[left.shape[0] // 2, c - 1]) / np.float32(2)
    if level:
        take_mean(left, level)
        take_mean(right, level)
    cost = differences(left, right, half, high)
    best, unlike, both = winners(cost, ratio)
    for c in range(width):
        k = best[c]
        good = k >= low and both[c] and cost[c, k] < np.float32(most) and steps[c] >= np.float32(least_step)
        if not good or agreeing(best, both, c, half) < agree * (2 * half + 1):
            unlike[c] = 0
    for n in range(out.shape[1]):
        c = 0
        if n < ahead and band[1] > band[0]:
            c = band[0] + int(unlike[band[0] : band[1]].argmax())
        if unlike[c] <= 0:
            c = int(unlike.argmax())
        if unlike[c] > 0:
            out[0, n], out[1, n], out[2, n] = c, c - (best[c] + shift(cost[c], best[c])), cost[c, best[c]]
            unlike[max(0, c - spacing) : c + spacing + 1] = 0


@numba.njit(fastmath=FAST, error_model="numpy")
def take_mean(rows: Floats, reach: int) -> None:
    """Take from every pixel the mean of those of its row within `reach`."""
    width = rows.shape[1]
    for r in range(rows.shape[0]):
        row = rows[r].copy()
        total, count = 0.0, min(reach, width)
        for x in range(count):
            total += row[x]
        for x in range(width):
            if x + reach < width:
                total, count = total + row[x + reach], count + 1
            if x - reach > 0:
                total, count = total - row[x - reach - 1], count - 1
            rows[r, x] = row[x] - np.float32(total / count)


@numba.njit(fastmath=FAST, error_model="numpy")
def differences(left: Floats, right: Floats, half: int, high: int) -> Floats:
    """Mean difference of the windows around every left column and the right ones 0 to `high` to the left of it."""
    rows, width = left.shape
    depth, size = high + 1, 2 * half + 1
    # Turned round, so that the inner loops run over neighbours in memory.
    turned = np.zeros((rows, width + depth), np.float32)
    for r in range(rows):
        for x in range(width):
            turned[r, x] = right[r, width - 1 - x]
    apart = np.zeros((width, depth), np.float32)
    for c in range(width):
        line, reach = apart[c], min(depth, c + 1)
        for r in range(rows):
            here, there = left[r, c], turned[r, width - 1 - c :]
            for k in range(reach):
                line[k] += abs(here - there[k])
    cost = np.full((width, depth), NEVER, np.float32)
    total, share = np.zeros(depth, np.float32), np.float32(1 / (size * rows))
    for c in range(width):
        new = apart[c]
        for k in range(depth):
            total[k] += new[k]
        if c < size - 1:
            continue
        line = cost[c - half]
        for k in range(min(depth, c - size + 2)):
            line[k] = total[k] * share
        old = apart[c - size + 1]
        for k in range(depth):
            total[k] -= old[k]
    return cost


@numba.njit(fastmath=FAST, error_model="numpy")
def winners(cost: Floats, ratio: float) -> tuple[Whole, Floats, npt.NDArray[np.bool_]]:
    """Of every column the best disparity, how unlike all others it is (0: too like), and if the right says the same."""
    width, depth = cost.shape
    best, unlike = np.full(width, -1, np.int32), np.zeros(width, np.float32)
    back, least_back = np.full(width, -1, np.int32), np.full(width, NEVER, np.float32)
    for c in range(width):
        line, least = cost[c], NEVER
        for k in range(depth):
            least = min(least, line[k])
        if least >= NEVER:
            continue
        k = 0
        while line[k] != least:
            k += 1
        best[c], second = k, NEVER
        for other in range(k - NEIGHBOURS):
            second = min(second, line[other])
        for other in range(k + NEIGHBOURS + 1, depth):
            second = min(second, line[other])
        if second < NEVER and least < np.float32(ratio) * second:
            unlike[c] = 1 - least / second
        for k in range(min(depth, c + 1)):
            if line[k] < least_back[c - k]:
                least_back[c - k], back[c - k] = line[k], k
    both = np.zeros(width, np.bool_)
    for c in range(width):
        both[c] = best[c] >= 0 and abs(back[c - best[c]] - best[c]) <= 1
    return best, unlike, both


@numba.njit(error_model="numpy")
def agreeing(best: Whole, both: npt.NDArray[np.bool_], column: int, reach: int) -> int:
    """How many columns within reach were found where one surface through all of them could be."""
    count = 0
    for x in range(max(0, column - reach), min(len(best), column + reach + 1)):
        if both[x] and 2 * abs(best[x] - best[column]) <= 2 + abs(x - column):
            count += 1
    return count


@numba.njit(error_model="numpy")
def shift(line: Floats, k: int) -> float:
    """Where between its neighbours the smallest cost is, by a parabola."""
    if not 0 < k < len(line) - 1 or line[k - 1] >= NEVER or line[k + 1] >= NEVER:
        return 0.0
    curve = line[k - 1] + line[k + 1] - 2 * line[k]
    if curve <= 1e-9:
        return 0.0
    place: float = min(max((line[k - 1] - line[k + 1]) / (2 * curve), -0.5), 0.5)
    return place
