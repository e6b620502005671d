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

from dataclasses import dataclass

import torch
from torch import Tensor

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.stereo._kernels_search import SearchNumbers, find_places
from ndtorch.navigation.stereo.correspondence import Matches


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

    def numbers(self, band: tuple[int, int]) -> SearchNumbers:
        """What the compiled search takes; `band` are the columns, from and up to, that see what lies ahead."""
        values = {name: getattr(self, name) for name in SearchNumbers._fields[1:-2]}
        for name in ("ratio", "max_difference", "min_step", "agree"):
            values[name] = float(values[name])
        return SearchNumbers(self.count, **values, band_start=band[0], band_end=band[1])


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
    pairs = rows.detach().reshape(-1, *rows.shape[-3:]).to("cpu", torch.float32)
    pairs, numbers = pairs.clone(memory_format=torch.contiguous_format), params.numbers(band)
    found = torch.zeros(len(pairs), 3, params.count)
    for (left, right), out in zip(pairs.numpy(), found.numpy(), strict=True):
        find_places(left, right, numbers, out)
    left, right, error = found.view(*rows.shape[:-3], 3, params.count).to(rows).unbind(-2)
    return Matches(left, right, error, left > 0)
