"""Ranges by searching the right row for the surroundings of places of the left one.

The published way matches the few places of either row that move most, with 3 pixels each. Where much looks alike, as
between many like posts, it finds next to nothing. This one compares 17 pixels by 3 rows around every place of the left
row with all places of the right row (sum of absolute differences), and accepts what

- is unlike all other places of the right row (so that repeated posts give nothing),
- is found from the right as well (so that what only one camera sees gives nothing), and
- agrees with the places around it: they are found where one surface through all of them could be.

From every pixel the mean of its surroundings is taken before, so that the cameras may differ in exposure. It needs no
motion, so it also works for a car that stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.body import Body
from ndtorch.navigation.stereo._kernels import Array, Frames, grey_fields, packed, triangulate
from ndtorch.navigation.stereo.features import USUAL_FOCAL_BASELINE, Matches
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.utils.jit import jit


@dataclass(frozen=True)
class SearchParams:
    """How the right row is searched.

    Args:
        count: Highest number of places of a row that are ranged.
        rows: Number of rows that are compared, odd, with the horizon in their middle.
        half_width_px: Places are compared with this many pixels to either side.
        mean_half_width_px: The mean of the pixels within this distance is taken from each pixel; 0 takes nothing.
        min_disparity_px: A place of a smaller disparity is found and left out, so that it is not taken for a near
            object; 20 pixels are 6.5 m for the rig of [A].
        max_disparity_px: Largest disparity that is searched for; 230 pixels are 0.56 m for the rig of [A].
        uniqueness_ratio: A match differs by less than this ratio of the best one elsewhere.
        max_difference_ratio: Largest mean difference of a match, as a ratio of white.
        min_step_ratio: Least step of brightness from one pixel of a place to the next, as a ratio of white.
        agreement_ratio: Ratio of the columns around a place whose matches must agree with its own: by 1 pixel
            of disparity, and half a pixel more for every pixel between them, which a wall seen at an angle needs.
        spacing_px: Places lie more than this far apart.
    """

    count: int = 16
    rows: int = 3
    half_width_px: int = 8
    mean_half_width_px: int = 30
    min_disparity_px: int = 20
    max_disparity_px: int = 230
    uniqueness_ratio: float = 0.8
    max_difference_ratio: float = 0.05
    min_step_ratio: float = 0.004
    agreement_ratio: float = 1.0
    spacing_px: int = 4

    def __post_init__(self) -> None:
        check_numbers(self, positive=("count", "rows", "half_width_px", "max_difference_ratio", "uniqueness_ratio"))
        if self.rows % 2 == 0 or not 1 <= self.min_disparity_px < self.max_disparity_px - 1:
            raise InputError(f"expected odd rows and 1 <= min_disparity_px < max_disparity_px - 1, got {self}")

    @classmethod
    def for_body(cls, rig: StereoRig, body: Body, rows: int = 1) -> SearchParams:
        """The disparities at which a body needs ranges, as the defaults are for the car and the rig of [A].

        Rooms do not shrink with a body: small ones are also searched for what is as far as the car of [A] sees, since
        it would match as something near otherwise.
        """
        ratio = rig.focal * rig.baseline / body.unit_m / USUAL_FOCAL_BASELINE
        least = max(1, round(ratio * min(1.0, body.unit_m) * cls.min_disparity_px))
        most = round(ratio * body.unit_m / body.size_m * cls.max_disparity_px)
        most = max(least + 2, min(most, rig.width - 4 * cls.half_width_px))
        return cls(rows=rows, min_disparity_px=least, max_disparity_px=most)


def search_rows(rows: Tensor, params: SearchParams) -> Matches:
    """Places of the left row and where the right row shows the same, in compiled code without gradients.

    Args:
        rows: in 0..1, `[..., 2, W]`, left first, or `[..., 2, R, W]` with an odd number R of rows.

    Returns:
        `Matches` of `[..., n]`, those most unlike all others first. Columns are whole numbers on the left, and
        fractions on the right; slots without a place hold 0.

    Raises:
        InputError: rows of another shape, or narrower than what is compared.
    """
    given = rows.shape
    if rows.ndim >= 2 and rows.shape[-2] == 2:
        rows = rows.unsqueeze(-2)
    compared = 2 * params.half_width_px + 1
    if rows.ndim < 3 or rows.shape[-3] != 2 or rows.shape[-2] % 2 == 0 or rows.shape[-1] < compared:
        raise InputError(
            f"expected rows [..., 2, W] or [..., 2, R, W] with R odd and W >= {compared}, got {tuple(given)}"
        )
    pairs = rows.detach().reshape(-1, *rows.shape[-3:]).to("cpu", torch.float32, copy=True).contiguous()
    out = torch.zeros(len(pairs), 3, params.count)
    for pair, places in zip(pairs.numpy(), out.numpy(), strict=True):
        find_places(pair, packed(params), places)
    left, right, error = out.view(*rows.shape[:-3], 3, params.count).to(rows).unbind(-2)
    return Matches(left, right, error, left > 0)


NEIGHBOURS = 2  # disparities this near to the best one do not count as another place
NEVER = np.float32(9.0)  # more than two windows can differ: where one of them leaves its row


@jit(exact=True)
def search_ranges(
    frames: Frames, rows: int, numbers: Array, geometry: Array, low: Array, out: Array, valid: Array
) -> float:
    """The step of `StereoRanging` that searches the right row; returns the largest number in the rows.

    Args:
        frames, rows: where the rows are that are compared, and how many.
        numbers, geometry: packed parameters of the search and of `triangulate`.
        low: becomes the horizon rows, `[2, W]`.
        out: becomes range, left and right angle, x and y, `[5, n]`; `valid`: `[n]`.
    """
    pair, found = np.empty((2, rows, low.shape[1]), np.float32), np.empty((3, valid.shape[0]), np.float32)
    finite = grey_fields(frames, 1, pair)
    peak = max(pair.max(), -pair.min()) if finite else np.nan
    if not peak <= 2.0:  # the search indexes by what it reads
        return float(peak)
    low[:] = pair[:, rows // 2]
    find_places(pair, numbers, found)
    out[0], valid[:] = found[1], found[0] > 0
    triangulate(found[0], geometry, out, valid)
    return float(peak)


@jit(exact=True)
def find_places(pair: Array, numbers: Array, out: Array) -> None:
    """Fill `out` `[3, n]` with left columns (0 where there is none), right columns and mean differences.

    Args:
        pair: rows `[2, R, W]`, spoiled where they are leveled.
        numbers: `packed` `SearchParams`.
    """
    p, half, middle = numbers[0], numbers[0].half_width_px, pair.shape[1] // 2
    width, unlike = pair.shape[2], np.zeros(pair.shape[2], np.float32)
    for c in range(1, width - 1):
        if abs(pair[0, middle, c + 1] - pair[0, middle, c - 1]) >= 2 * p.min_step_ratio:
            unlike[c] = 1
    if p.mean_half_width_px:
        take_mean(pair.reshape(-1, width), p.mean_half_width_px)
    best, back, around = np.full(width, -1, np.int32), np.zeros(width, np.int32), np.full((4, width), NEVER, np.float32)
    compare_rows(pair, half, p.max_disparity_px, best, back, around)
    for c in range(width):
        cost, other = around[1, c], max(around[3, c], np.float32(1e-6))
        unlike[c] *= max(0.0, 1 - cost / other)
        if best[c] < p.min_disparity_px or cost >= p.max_difference_ratio or cost >= p.uniqueness_ratio * other:
            unlike[c] = 0
        if unlike[c] == 0 or other >= NEVER:
            unlike[c] = 0
            continue
        agreeing = 0
        for x in range(max(0, c - half), min(width, c + half + 1)):
            mutual = best[x] >= 0 and abs(back[x] - best[x]) <= 1
            agreeing += mutual and 2 * abs(best[x] - best[c]) <= 2 + abs(x - c)
        if abs(back[c] - best[c]) > 1 or agreeing < p.agreement_ratio * (2 * half + 1):
            unlike[c] = 0
    for n in range(out.shape[1]):
        c = int(unlike.argmax())
        out[:, n] = 0
        if unlike[c] > 0:
            # Between its neighbours the smallest of three lies where a parabola through them does.
            before, here, after = around[0, c], around[1, c], around[2, c]
            curve, shift = before + after - 2 * here, 0.0
            if before < NEVER and after < NEVER and curve > 1e-9:
                shift = min(max((before - after) / (2 * curve), -0.5), 0.5)
            out[0, n], out[1, n], out[2, n] = c, c - (best[c] + shift), here
            unlike[max(0, c - p.spacing_px) : c + p.spacing_px + 1] = 0


@jit
def take_mean(rows: Array, reach: int) -> None:
    """Take from every pixel of rows `[R, W]` the mean of those of its row within `reach`."""
    width, sums = rows.shape[1], np.zeros(rows.shape[1] + 1)
    for row in rows:
        for x in range(width):
            sums[x + 1] = sums[x] + row[x]
        for x in range(width):
            first, last = max(0, x - reach), min(width, x + reach + 1)
            row[x] -= (sums[last] - sums[first]) / (last - first)


@jit
def compare_rows(pair: Array, half: int, most: int, best: Array, back: Array, around: Array) -> None:
    """Every window of the left rows beside those of the right ones: where it fits best, in one pass over the columns.

    Args:
        pair: `[2, R, W]`.
        half, most: columns of a window to either side, and the largest disparity.
        best: becomes the disparity of every left column, `[W]`; stays where its window leaves the row.
        back: becomes the disparity of the right column that it fits, `[W]`.
        around: becomes the mean difference at the disparity before, there and after it, and the least elsewhere,
            `[4, W]`.
    """
    _, rows, width = pair.shape
    depth, size = most + 1, 2 * half + 1
    # Turned round, so that the inner loops run over neighbours in memory.
    turned = np.zeros((rows, width + depth), np.float32)
    for r in range(rows):
        for x in range(width):
            turned[r, x] = pair[1, r, width - 1 - x]
    new, total, share = np.zeros(depth, np.float32), np.zeros(depth, np.float32), np.float32(1 / (size * rows))
    windows, line = np.zeros((size, depth), np.float32), np.empty(depth, np.float32)
    # Numbers of 0 or more are in the order of their bits, and the least of whole numbers becomes vector instructions.
    bits, lowest = line.view(np.int32), np.full(width + depth, NEVER, np.float32)
    lowest_bits, lowest_at = lowest.view(np.int32), np.zeros(width + depth, np.int32)
    for c in range(width):
        start, reach, n, m = width - 1 - c, min(depth, c + 1), min(depth, c - size + 2), c - half
        new[:reach] = 0
        for r in range(rows):
            add_differences(pair[0, r, c], turned[r, start:], new[:reach])
        move_window(new[:reach], windows[c % size], total, line, share)
        if n <= 0:
            continue
        keep_lower(bits[:n], lowest_bits[width - 1 - m :], lowest_at[width - 1 - m :])
        least, k = least_of(bits[:n]), 0
        while bits[k] != least:
            k += 1
        best[m], around[1, m] = k, line[k]
        if k > 0:
            around[0, m] = line[k - 1]
        if k + 1 < n:
            around[2, m] = line[k + 1]
        bits[max(0, k - NEIGHBOURS) : min(n, k + NEIGHBOURS + 1)] = NEVER_BITS
        bits[0] = least_of(bits[:n])
        around[3, m] = line[0]
    for c in range(width):
        back[c] = lowest_at[width - 1 - c + max(best[c], 0)]


NEVER_BITS = NEVER.view(np.int32)


@jit
def add_differences(pixel: float, right: Array, new: Array) -> None:
    for k in range(new.shape[0]):
        new[k] += abs(pixel - right[k])


@jit
def move_window(new: Array, oldest: Array, total: Array, line: Array, share: float) -> None:
    """Windows move on by a column: their sums lose the oldest one, which becomes the new one."""
    for k in range(new.shape[0]):
        value = total[k] + new[k] - oldest[k]
        oldest[k] = new[k]
        total[k] = value
        line[k] = max(value * share, np.float32(0))  # rounding may leave a little less than 0


@jit
def keep_lower(costs: Array, lowest: Array, at: Array) -> None:
    for k in range(costs.shape[0]):
        at[k] = k if costs[k] < lowest[k] else at[k]
        lowest[k] = min(lowest[k], costs[k])


@jit
def least_of(bits: Array) -> int:
    least = NEVER_BITS
    for k in range(bits.shape[0]):
        least = min(least, bits[k])
    return int(least)
