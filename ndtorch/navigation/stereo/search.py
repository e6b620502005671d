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
        count: At most this many places of a row are ranged.
        rows: This odd number of rows is compared, the horizon in their middle.
        half_width_px: Places are compared with this many pixels to either side.
        mean_half_width_px: The mean of the pixels within this distance is taken from each pixel; 0 takes nothing.
        min_disparity_px: A place of a smaller disparity is found and left out, so that it is not taken for a near
            object; 20 pixels are 6.5 m for the rig of [A].
        max_disparity_px: No larger disparity is searched for; 230 pixels are 0.56 m for the rig of [A].
        uniqueness_ratio: A match differs by less than this share of the best one elsewhere.
        max_difference_ratio: A match differs on average by at most this share of white.
        min_step_ratio: A place has a step of brightness from one pixel to the next of at least this share of white.
        agreement_ratio: This share of the columns around a place must have matches that agree with its own: by 1 pixel
            of disparity, and half a pixel more for every pixel between them, which a wall seen at an angle needs.
        spacing_px: Places lie more than this far apart.
        ahead_count: This many of the places are reserved for what lies ahead, as long as there are any.

    Raises:
        InputError: A number is out of range.
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
    ahead_count: int = 0

    def __post_init__(self) -> None:
        check_numbers(self, positive=("count", "rows", "half_width_px", "spacing_px", "max_difference_ratio"))
        if not (self.rows % 2 == 1 and self.ahead_count <= self.count):
            raise InputError(f"rows must be odd, and ahead_count between 0 and count, got {self}")
        if not 1 <= self.min_disparity_px < self.max_disparity_px - 1:
            raise InputError(f"expected 1 <= min_disparity_px < max_disparity_px - 1, got {self}")
        if not (0 < self.uniqueness_ratio <= 1 and self.agreement_ratio <= 1):
            raise InputError(f"expected 0 < uniqueness_ratio <= 1 and agreement_ratio <= 1, got {self}")

    def numbers(self, band: tuple[int, int]) -> SearchNumbers:
        """What the compiled search takes; `band` are the columns, from and up to, that see what lies ahead."""
        p = self
        return SearchNumbers(
            places=p.count,
            level=p.mean_half_width_px,
            half=p.half_width_px,
            min_disparity=p.min_disparity_px,
            max_disparity=p.max_disparity_px,
            ratio=float(p.uniqueness_ratio),
            max_difference=float(p.max_difference_ratio),
            min_step=float(p.min_step_ratio),
            agree=float(p.agreement_ratio),
            spacing=p.spacing_px,
            ahead=p.ahead_count,
            band_start=band[0],
            band_end=band[1],
        )


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
    compared = 2 * params.half_width_px + 1
    if rows.ndim < 3 or rows.shape[-3] != 2 or rows.shape[-2] % 2 == 0 or rows.shape[-1] < compared:
        raise InputError(f"expected rows [..., 2, W] or [..., 2, R, W] with R odd and W >= {compared}, got {given}")
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
