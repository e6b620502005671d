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
        min_disparity, max_disparity: a match counts only with `min < d < max`, pixels, 0 <= min.
        one_to_one: a right feature belongs to the left feature that it resembles most, and to no other.
        max_error: partners that differ by more than this, [A eq. A.2], are no match; not in [A].
    """

    min_disparity: float = 60.0
    max_disparity: float = 200.0
    one_to_one: bool = True
    max_error: float = math.inf

    def __post_init__(self) -> None:
        check_numbers(self)
        if not 0 <= self.min_disparity < self.max_disparity:
            raise InputError(
                f"expected 0 <= min_disparity < max_disparity, got {self.min_disparity}, {self.max_disparity}"
            )
        if not self.max_error > 0:
            raise InputError(f"max_error must be > 0, got {self.max_error}")


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
    valid = (best < params.max_error) & (disparity > params.min_disparity) & (disparity < params.max_disparity)
    if params.one_to_one:
        owner = error.argmin(-2).gather(-1, partner)
        valid = valid & (owner == torch.arange(owner.shape[-1], device=owner.device))
    return Matches(left.column, column, best, valid)
