"""Which feature of the right row is which of the left one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.stereo.features import Features, patch_error


@dataclass(frozen=True)
class MatchParams:
    """How features are matched. [A Methods]

    Args:
        min_disparity_px: A match has a larger disparity than this, which is 0 or more.
        max_disparity_px: A match has a smaller disparity than this.
        one_to_one: A right feature belongs to the left feature that it resembles most, and to no other.
        max_error: Partners whose patches differ by more than this, [A eq. A.2], are no match. Not in [A].

    Raises:
        InputError: A number is out of range.
    """

    min_disparity_px: float = 60.0
    max_disparity_px: float = 200.0
    one_to_one: bool = True
    max_error: float = math.inf

    def __post_init__(self) -> None:
        check_numbers(self, positive=("max_error",))
        if not 0 <= self.min_disparity_px < self.max_disparity_px:
            raise InputError(
                "expected 0 <= min_disparity_px < max_disparity_px, "
                f"got {self.min_disparity_px}, {self.max_disparity_px}"
            )


class Matches(NamedTuple):
    """Left features and their partners, all `[..., n]`, in the order of the left features.

    Attributes:
        left, right: columns of the feature in the left and the right row.
        error: squared difference of the patches, [A eq. A.2]; infinite where there is no right feature.
        valid: bool; only there `min_disparity < left - right < max_disparity`.
    """

    left: Tensor
    right: Tensor
    error: Tensor
    valid: Tensor


def match_features(left: Features, right: Features, params: MatchParams | None = None) -> Matches:
    """For each left feature the right one with the smallest 3-pixel squared difference. [A eq. A.2]

    Only afterwards the disparity `d = left column - right column` must lie in its window: a window on the
    candidates would force false partners on features whose true partner is outside. The disparity is signed,
    because what is seen by parallel cameras lies further to the right in the left image.

    Raises:
        InputError: features of different batch shapes.
    """
    params = params or MatchParams()
    if left.column.shape[:-1] != right.column.shape[:-1]:
        raise InputError(
            f"expected features of the same rows, got {tuple(left.column.shape)} and {tuple(right.column.shape)}"
        )
    error = patch_error(left.patch, right.patch)
    error = error.masked_fill(~(left.valid.unsqueeze(-1) & right.valid.unsqueeze(-2)), float("inf"))
    best, partner = error.min(-1)
    column = right.column.gather(-1, partner)
    disparity = left.column - column
    # Without a partner the error is infinite, which is below no limit.
    valid = (best < params.max_error) & (disparity > params.min_disparity_px) & (disparity < params.max_disparity_px)
    if params.one_to_one:
        owner = error.argmin(-2).gather(-1, partner)
        valid = valid & (owner == torch.arange(owner.shape[-1], device=owner.device))
    return Matches(left.column, column, best, valid)
