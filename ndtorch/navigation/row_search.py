"""Ranges by searching the right row for the surroundings of each edge of the left one.

The published way matches the few places of either row that move most, with 3 pixels each. Where much looks alike, as
between many like posts, it finds next to nothing. This one compares 15 pixels around a place of the left row with all
places of the right row (sum of absolute differences), and believes what is unlike all others and found from the
right as well. It needs no motion, so it also works for a car that stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.kernels.load import kernel
from ndtorch.navigation.correspondence import Matches
from ndtorch.optional import need


@dataclass(frozen=True)
class SearchParams:
    """How the right row is searched.

    Args:
        count: places of a row that are ranged at most, n.
        half: pixels compared to either side of a place.
        min_disparity, max_disparity: pixels; 20 and 230 are 6.5 and 0.56 m for the rig of [A].
        ratio: a match must differ by less than this share of the best one elsewhere.
        max_difference: mean difference of a match at most, for intensities 0..1.
        min_step: least step of brightness from one pixel to the next at a place.
        spacing: places lie more than this many pixels apart.

    Raises:
        InputError: numbers out of range.
    """

    count: int = 48
    half: int = 7
    min_disparity: int = 20
    max_disparity: int = 230
    ratio: float = 0.65
    max_difference: float = 0.05
    min_step: float = 0.01
    spacing: int = 4

    def __post_init__(self) -> None:
        if not (self.count >= 1 and self.half >= 1 and self.spacing >= 1):
            raise InputError(f"count, half and spacing must be 1 or more, got {self}")
        if not 1 <= self.min_disparity < self.max_disparity - 1:
            raise InputError(f"expected 1 <= min_disparity < max_disparity - 1, got {self}")
        if not (0 < self.ratio <= 1 and self.max_difference > 0 and self.min_step >= 0):
            raise InputError(f"expected 0 < ratio <= 1, max_difference > 0 and min_step >= 0, got {self}")


def search_rows(rows: Tensor, params: SearchParams) -> Matches:
    """Places of the left row and where the right row shows the same, of rows `[..., 2, W]` in 0..1, left first.

    Returns:
        `Matches` of `[..., n]`, the largest steps of brightness first; columns are whole numbers on the left, and
        fractions on the right.
    """
    need("numba", 'ranging "search"')
    search = kernel("search_row")
    p, flat = params, rows.detach().reshape(-1, 2, rows.shape[-1]).to(torch.float32).contiguous().numpy()
    found = torch.zeros(len(flat), 3, p.count)
    out = found.numpy()
    for n in range(len(flat)):
        search.run(
            flat[n, 0],
            flat[n, 1],
            p.half,
            p.min_disparity,
            p.max_disparity,
            p.ratio,
            p.max_difference,
            p.min_step,
            p.spacing,
            out[n],
        )
    left, right, error = found.view(*rows.shape[:-2], 3, p.count).to(rows.dtype).unbind(-2)
    return Matches(left, right, error, left > 0)
