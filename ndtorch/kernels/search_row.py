"""Where the right rows show the surroundings of a place of the left ones, see `ndtorch.navigation.row_search`."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from ndtorch.kernels.load import FAST

Floats = npt.NDArray[np.float32]
Whole = npt.NDArray[np.int32]

Numbers = tuple[int, int, int, int, float, float, float, float, int, int]

NEIGHBOURS = 2
"""As in `ndtorch.navigation.row_search`."""

TINY = np.float32(1e-6)
"""As in `ndtorch.navigation.row_search`."""

NEVER = np.float32(9.0)
"""More than two windows can differ: where one of them leaves its row."""


def search_row(left: Floats, right: Floats, params: Numbers, band: tuple[int, int], out: Floats) -> None:
    """`find_places` of one pair of rows."""
    find_places(left, right, params, band, out)


@numba.njit(error_model="numpy")
def find_places(left: Floats, right: Floats, params: Numbers, band: tuple[int, int], out: Floats) -> None:
    """Fill `out` `[3, n]` with left columns (0 where there is none), right columns and mean differences.

    Args:
        left, right: rows `[R, W]`, spoiled where they are leveled.
        params: `level`, `half`, least and largest disparity, `ratio`, `max_difference`, `min_step`, `agree`, `spacing`
            and `ahead`, see `SearchParams`.
        band: columns, from and up to, in which the first `ahead` places lie, as far as there are any.
    """
    level, half, low, high, ratio, most, least_step, agree, spacing, ahead = params
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
    out[:] = 0
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
    # Numbers of 0 or more are in the same order as their bits, and the least of whole numbers is found much faster.
    bits, never = cost.view(np.int32), np.full(1, NEVER, np.float32).view(np.int32)[0]
    # Of every right column, the last one first, so that the inner loop runs over neighbours in memory.
    least_back = np.full(width + depth, never, np.int32)
    for c in range(width):
        line, back, least = bits[c], least_back[width - 1 - c :], never
        for k in range(depth):
            least = min(least, line[k])
            back[k] = min(back[k], line[k])
        if least >= never:
            continue
        k = 0
        while line[k] != least:
            k += 1
        best[c], second = k, never
        for other in range(k - NEIGHBOURS):
            second = min(second, line[other])
        for other in range(k + NEIGHBOURS + 1, depth):
            second = min(second, line[other])
        if second < never:
            share = cost[c, k] / max(np.full(1, second, np.int32).view(np.float32)[0], TINY)
            unlike[c] = 1 - share if share < np.float32(ratio) else 0
    both = np.zeros(width, np.bool_)
    for c in range(width):
        k = best[c]
        if k >= 0:
            least = least_back[width - 1 - c + k]
            for d in range(max(k - 1, 0), min(k + 2, depth, width - c + k)):
                both[c] = both[c] or bits[c - k + d, d] <= least
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
