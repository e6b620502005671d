"""Ranges by searching the right row for the surroundings of places of the left one.

The published way matches the few places of either row that move most, with 3 pixels each. Where much looks alike, as
between many like posts, it finds next to nothing. This one compares 17 pixels by 3 rows around every place of the left
row with all places of the right row (sum of absolute differences), and believes what

- is unlike all other places of the right row (so that repeated posts give nothing),
- is found from the right as well (so that what only one camera sees gives nothing), and
- agrees with the places around it: they are found where one surface through all of them could be.

From every pixel the mean of its surroundings is taken before, so that the cameras may differ in exposure. It needs no
motion, so it also works for a car that stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.kernels.search_row import search_row
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.navigation.correspondence import Matches

NEIGHBOURS = 2
"""Disparities this near to the best one do not count as another place."""


TINY = 1e-6
"""A mean difference below this is as good as none."""


@dataclass(frozen=True)
class SearchParams:
    """How the right row is searched.

    Args:
        count: places of a row that are ranged at most, n.
        rows: of pixels that are compared, the horizon in their middle; odd.
        half: pixels compared to either side of a place.
        level: from every pixel the mean of those within so many to either side is taken; 0 takes nothing.
        min_disparity, max_disparity: pixels; 20 and 230 are 6.5 and 0.56 m for the rig of [A]. Whatever lies farther
            away is searched for too, so that it is not taken for something near, and then left out.
        ratio: a match must differ by less than this share of the best one elsewhere.
        max_difference: mean difference of a match at most, for intensities 0..1.
        min_step: least step of brightness from one pixel to the next at a place.
        agree: share of the `2 half + 1` columns around a place whose matches must agree with its own: by 1 pixel of
            disparity, and half a pixel more for every pixel between them, which a wall seen at an angle needs.
        spacing: places lie more than this many pixels apart.
        ahead: so many of the `count` places are kept for what lies ahead, as long as there are any.

    Raises:
        InputError: numbers out of range.
    """

    count: int = 16
    rows: int = 3
    half: int = 8
    level: int = 30
    min_disparity: int = 20
    max_disparity: int = 230
    ratio: float = 0.8
    max_difference: float = 0.05
    min_step: float = 0.004
    agree: float = 1.0
    spacing: int = 4
    ahead: int = 0

    def __post_init__(self) -> None:
        check_numbers(self)
        if not (self.count >= 1 and self.half >= 1 and self.spacing >= 1 and self.level >= 0):
            raise InputError(f"count, half and spacing must be 1 or more, and level 0 or more, got {self}")
        if not (self.rows >= 1 and self.rows % 2 == 1 and 0 <= self.ahead <= self.count):
            raise InputError(f"rows must be odd, and ahead between 0 and count, got {self}")
        if not 1 <= self.min_disparity < self.max_disparity - 1:
            raise InputError(f"expected 1 <= min_disparity < max_disparity - 1, got {self}")
        if not (0 < self.ratio <= 1 and self.max_difference > 0 and self.min_step >= 0 and 0 <= self.agree <= 1):
            raise InputError(
                f"expected 0 < ratio <= 1, max_difference > 0, min_step >= 0 and 0 <= agree <= 1, got {self}"
            )

    @property
    def numbers(self) -> tuple[int, int, int, int, float, float, float, float, int, int]:
        """What the kernels take, in their order."""
        places = (self.level, self.half, self.min_disparity, self.max_disparity)
        limits = (float(self.ratio), float(self.max_difference), float(self.min_step), float(self.agree))
        return (*places, *limits, self.spacing, self.ahead)


def search_rows(rows: Tensor, params: SearchParams, band: tuple[int, int] | None = None) -> Matches:
    """Places of the left row and where the right row shows the same.

    Args:
        rows: in 0..1, `[..., 2, W]`, left first, or `[..., 2, R, W]` with an odd number R of rows.
        band: columns, from and up to, that see what lies ahead; the middle third by default.

    Returns:
        `Matches` of `[..., n]`: the places ahead that are kept, then all others, those most unlike all others first
        in either. Columns are whole numbers on the left, and fractions on the right; slots without a place hold 0.

    Raises:
        InputError: rows of another shape, or narrower than what is compared.
    """
    given = tuple(rows.shape)
    if rows.ndim >= 2 and rows.shape[-2] == 2:
        rows = rows.unsqueeze(-2)
    if rows.ndim < 3 or rows.shape[-3] != 2 or rows.shape[-2] % 2 == 0 or rows.shape[-1] < 2 * params.half + 1:
        raise InputError(
            f"expected rows [..., 2, W] or [..., 2, R, W] with R odd and W >= {2 * params.half + 1}, got {given}"
        )
    width = rows.shape[-1]
    start, end = band or (width // 3, width - width // 3)
    band = (min(max(start, 0), width), min(max(end, 0), width))
    search = by_kernel if kernels_wanted(rows) else by_torch
    flat = rows.detach().reshape(-1, *rows.shape[-3:]).to(torch.float32)
    found = search(flat, params, band)
    left, right, error = found.view(*rows.shape[:-3], 3, params.count).to(rows.dtype).unbind(-2)
    return Matches(left, right, error, left > 0)


def by_kernel(rows: Tensor, params: SearchParams, band: tuple[int, int]) -> Tensor:
    """Left and right columns and differences `[B, 3, n]` of rows `[B, 2, R, W]`."""
    pairs = rows.clone(memory_format=torch.contiguous_format).numpy()
    found = torch.zeros(len(rows), 3, params.count)
    for (left, right), out in zip(pairs, found.numpy(), strict=True):
        search_row(left, right, params.numbers, band, out)
    return found


def by_torch(rows: Tensor, params: SearchParams, band: tuple[int, int]) -> Tensor:
    """The same in torch, on any device."""
    p, middle = params, rows[:, 0, rows.shape[2] // 2]
    step = F.pad((middle[:, 2:] - middle[:, :-2]).abs() / 2, (1, 1))
    if p.level:
        flat = rows.flatten(0, 2).unsqueeze(1)
        means = F.avg_pool1d(flat, 2 * p.level + 1, 1, p.level, count_include_pad=False)
        rows = rows - means.view_as(rows)
    cost = differences(rows[:, 0], rows[:, 1], p.half, p.max_disparity)
    best, unlike, both = winners(cost, p.ratio)
    chosen = cost.gather(-1, best.unsqueeze(-1)).squeeze(-1)
    good = (best >= p.min_disparity) & both & (chosen < p.max_difference) & (step >= p.min_step)
    good &= agreeing(best, both, p.half) >= p.agree * (2 * p.half + 1)
    unlike = unlike * good
    found = cost.new_zeros(len(rows), 3, p.count)
    columns = torch.arange(cost.shape[1], device=cost.device)
    inside, shifts = (columns >= band[0]) & (columns < band[1]), shift(cost, best)
    for n in range(p.count):
        score, c = unlike.max(-1, keepdim=True)
        if n < p.ahead:
            there, place = (unlike * inside).max(-1, keepdim=True)
            score, c = torch.where(there > 0, there, score), torch.where(there > 0, place, c)
        match = torch.cat((c, c - best.gather(1, c) - shifts.gather(1, c), chosen.gather(1, c)), 1)
        found[:, :, n] = match * (score > 0)
        unlike = unlike.masked_fill(((columns - c).abs() <= p.spacing) & (score > 0), 0)
    return found


def differences(left: Tensor, right: Tensor, half: int, high: int) -> Tensor:
    """Mean difference `[B, W, high + 1]` of the windows around every left column and the right ones to the left of it.

    Infinite where one of them leaves its row.

    Args:
        left, right: `[B, R, W]`.
    """
    width = left.shape[-1]
    shifted = F.pad(right, (high, 0)).unfold(-1, high + 1, 1).flip(-1)  # [B, R, W, D]: right[c - d]
    apart = (left.unsqueeze(-1) - shifted).abs().mean(1)
    mean = F.avg_pool1d(apart.mT, 2 * half + 1, 1).mT
    cost = F.pad(mean, (0, 0, half, half), value=math.inf)
    column = torch.arange(width, device=left.device).unsqueeze(-1)
    disparity = torch.arange(high + 1, device=left.device)
    return cost.masked_fill(column - disparity < half, math.inf)


class Winners(NamedTuple):
    """What was found of every column, `[B, W]`.

    Attributes:
        best: disparity that differs least.
        unlike: 1 - its difference over the least elsewhere, 0 where that is not below the ratio.
        both: the right row, searched in the left one, says the same.
    """

    best: Tensor
    unlike: Tensor
    both: Tensor


def winners(cost: Tensor, ratio: float) -> Winners:
    """Of every column of `cost` `[B, W, D]` what fits best."""
    width, depth = cost.shape[1:]
    least, best = cost.min(-1)
    disparity = torch.arange(depth, device=cost.device)
    near = (disparity - best.unsqueeze(-1)).abs() <= NEIGHBOURS
    second = cost.masked_fill(near, math.inf).amin(-1)
    share = least / second.clamp_min(TINY)
    unlike = torch.where((share < ratio) & second.isfinite(), 1 - share, 0.0)
    # The right column x at disparity d is the left one x + d.
    column = torch.arange(width, device=cost.device).unsqueeze(-1) + disparity
    inside = column < width
    skewed = cost[:, column.clamp(max=width - 1), disparity].masked_fill(~inside, math.inf)
    back = skewed.argmin(-1)
    there = (torch.arange(width, device=cost.device) - best).clamp_min(0)
    both = least.isfinite() & ((back.gather(-1, there) - best).abs() <= 1)
    return Winners(best, unlike, both)


def agreeing(best: Tensor, both: Tensor, reach: int) -> Tensor:
    """How many columns within reach were found where one surface through all of them could be, `[B, W]`."""
    around = F.pad(best, (reach, reach)).unfold(-1, 2 * reach + 1, 1)
    found = F.pad(both, (reach, reach)).unfold(-1, 2 * reach + 1, 1)
    away = torch.arange(-reach, reach + 1, device=best.device).abs()
    return (found & (2 * (around - best.unsqueeze(-1)).abs() <= 2 + away)).sum(-1)


def shift(cost: Tensor, best: Tensor) -> Tensor:
    """Where between its neighbours the smallest cost is, by a parabola, `[B, W]`."""
    around = (best.unsqueeze(-1) + torch.arange(-1, 2, device=best.device)).clamp(0, cost.shape[-1] - 1)
    before, here, after = cost.gather(-1, around).unbind(-1)
    curve = before + after - 2 * here
    inside = (best > 0) & (best < cost.shape[-1] - 1) & curve.isfinite() & (curve > 1e-9)
    return ((before - after) / (2 * curve)).clamp(-0.5, 0.5).masked_fill(~inside, 0.0)
