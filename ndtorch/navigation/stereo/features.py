"""Visual features of both rows, the places where the image moves most, and which of the right belongs to which left."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.body import Body
from ndtorch.navigation.stereo._kernels import BLUR, EDGE_SIDE, SAME_EDGE
from ndtorch.navigation.stereo.rig import StereoRig

USUAL_FOCAL_BASELINE = 129.0
"""Pixels times metres of the rig of [A], for which the disparities of `MatchParams` and `SearchParams` are."""


@dataclass(frozen=True)
class FeatureParams:
    """What makes a feature. [A Methods]

    Args:
        count: Number of features of a row, n; 4 to 7 are equally good.
        spacing_px: Features lie farther apart than this, D_min.
        min_motion: Least raw ND-min output of a feature, T_min, for intensities 0..1.
        min_difference: Two features of a row whose patches differ by less than this are both dropped, T_sim.
        edge_reach_px: A feature is moved to the steepest step of brightness within this distance (`edge_places`); 0
            leaves it where the motion is largest, as published.
        shared: Features are looked for only where the other camera can see the same at
            `MatchParams.min_disparity_px`. Not in [A].
    """

    count: int = 5
    spacing_px: int = 3
    min_motion: float = 0.01
    min_difference: float = 0.008
    edge_reach_px: int = 0
    shared: bool = False

    def __post_init__(self) -> None:
        check_numbers(self, positive=("count",))


@dataclass(frozen=True)
class MatchParams:
    """How features are matched. [A Methods]

    Args:
        min_disparity_px: A match has a larger disparity than this, which is 0 or more.
        max_disparity_px: A match has a smaller disparity than this.
        one_to_one: A right feature belongs to the left feature that it resembles most, and to no other.
        max_error: Partners whose patches differ by more than this, [A eq. A.2], are no match. Not in [A].
    """

    min_disparity_px: float = 60.0
    max_disparity_px: float = 200.0
    one_to_one: bool = True
    max_error: float = math.inf

    def __post_init__(self) -> None:
        check_numbers(self, positive=("max_error",))
        if not self.min_disparity_px < self.max_disparity_px:
            raise InputError(f"expected min_disparity_px < max_disparity_px, got {self}")

    @classmethod
    def for_body(cls, rig: StereoRig, body: Body) -> MatchParams:
        """The disparities at which a body needs ranges, as the defaults are for the car and the rig of [A]."""
        ratio = rig.focal * rig.baseline / body.unit_m / USUAL_FOCAL_BASELINE
        return cls(ratio * cls.min_disparity_px, ratio * cls.max_disparity_px)


class Features(NamedTuple):
    """Features of rows, strongest first; n slots, of which `valid` tells the good ones."""

    # `[..., n]`, 0 is the leftmost pixel; whole numbers, or fractions where features are edges
    column: Tensor
    strength: Tensor  # `[..., n]`, |ND-min| there
    # `[..., n, 3]`, the row's intensities at `column - 1 .. column + 1`, or `EDGE_SIDE` from an edge
    patch: Tensor
    valid: Tensor  # `[..., n]`, bool. Slots that are not valid hold numbers without meaning


class Matches(NamedTuple):
    """Left features and their partners, all `[..., n]`, in the order of the left features."""

    left: Tensor  # left, right: columns of the feature in the left and the right row
    right: Tensor
    error: Tensor  # squared difference of the patches, [A eq. A.2]; infinite where there is no right feature
    valid: Tensor  # bool; only there `min_disparity < left - right < max_disparity`


def find_features(row: Tensor, motion: Tensor, params: FeatureParams | None = None) -> Features:
    """The n largest |ND-min| outputs of a row, each more than `spacing` pixels from the others. [A Methods]

    Then those that are too weak, or whose surroundings look like those of another feature of the row, lose
    their `valid`. The outermost pixel at either end cannot be a feature, because it has no 3-pixel patch.

    Args:
        row: intensities `[..., W]`.
        motion: ND-min outputs of that row, `[..., W]`.

    Raises:
        InputError: row and motion of different shapes, or too narrow for so many features.
    """
    params = params or FeatureParams()
    check_width(row, motion, params)
    column, strength, _ = pick(motion, params)
    return describe(row, column, strength, params)


def check_width(row: Tensor, motion: Tensor, params: FeatureParams) -> None:
    least = params.count * (2 * params.spacing_px + 1) + 2
    if row.shape != motion.shape or row.ndim < 1 or row.shape[-1] < least:
        raise InputError(
            f"expected row and motion of one shape [..., W >= {least}] for {params.count} features, "
            f"got {tuple(row.shape)} and {tuple(motion.shape)}"
        )


def pick(
    motion: Tensor, params: FeatureParams, expected: Tensor | None = None, reach: int = 0
) -> tuple[Tensor, Tensor, Tensor]:
    """Columns and magnitudes `[..., n]` of the strongest places of a row `[..., W]`, and which of them are new.

    Args:
        expected: columns within `reach` of which features are looked for first, `[..., n]`; one that is weaker there
            than `min_motion` is new.
    """
    magnitude, last = motion.abs(), motion.shape[-1] - 1
    magnitude[..., ::last] = -1.0  # the outermost pixels are never the largest
    spacing = torch.arange(-params.spacing_px, params.spacing_px + 1, device=motion.device)
    window = torch.arange(-reach, reach + 1, device=motion.device)
    columns, strengths, new = [], [], []
    for k in range(params.count if expected is not None else 0):
        assert expected is not None
        places = (expected[..., k : k + 1] + window).clamp(0, last)
        strength, index = magnitude.gather(-1, places).max(-1, keepdim=True)
        columns.append(places.gather(-1, index))
        strengths.append(strength)
        new.append(strength < params.min_motion)
        # Nothing is found there again; what is lost keeps nothing away but the border, which is excluded anyway.
        magnitude.scatter_(-1, torch.where(new[k], 0, columns[k] + spacing).clamp(0, last), -1.0)
    for k in range(params.count):
        strength, column = magnitude.max(-1, keepdim=True)
        if expected is None:
            columns.append(column)
            strengths.append(strength)
            new.append(torch.ones_like(strength, dtype=torch.bool))
        columns[k] = torch.where(new[k], column, columns[k])
        strengths[k] = torch.where(new[k], strength, strengths[k])
        magnitude.scatter_(-1, torch.where(new[k], column + spacing, 0).clamp(0, last), -1.0)
    return torch.cat(columns, -1), torch.cat(strengths, -1), torch.cat(new, -1)


def describe(row: Tensor, column: Tensor, strength: Tensor, params: FeatureParams) -> Features:
    """Cut the patches and drop weak and ambiguous features, and of two that meet at one edge the weaker one."""
    twin, sides = torch.zeros_like(strength, dtype=torch.bool), (-1.0, 0.0, 1.0)
    if params.edge_reach_px:
        column, sides = edge_places(row, column, params.edge_reach_px), (-EDGE_SIDE, 0.0, EDGE_SIDE)
        same = (column.unsqueeze(-1) - column.unsqueeze(-2)).abs() < SAME_EDGE
        weaker = strength.unsqueeze(-1) < strength.unsqueeze(-2)
        equal = strength.unsqueeze(-1) == strength.unsqueeze(-2)
        twin = (same & (weaker | equal.tril(-1))).any(-1)  # of two equals the later one
    patch = sample(row, column.unsqueeze(-1) + torch.tensor(sides, dtype=row.dtype, device=row.device))
    other = patch_error(patch, patch).masked_fill(twin.unsqueeze(-2), math.inf)
    other.diagonal(dim1=-2, dim2=-1).fill_(math.inf)
    valid = (strength >= params.min_motion) & ~twin & (other.amin(-1) >= params.min_difference)
    return Features(column, strength, patch, valid)


def edge_places(row: Tensor, column: Tensor, reach: int) -> Tensor:
    """Where the edges are that made the motion at `column` `[..., n]`, as fractions of pixels.

    An edge that sweeps over v pixels between two frames changes all of them: the largest |ND-min| lies anywhere in a
    band v wide. The edge itself is now at one end of it: the steepest step of `row` `[..., W]` within `reach` pixels.
    Its place is the centroid of the step over `BLUR` pixels on either side, exact for a step that pixels average.
    """
    width = row.shape[-1]
    step = row[..., 1:] - row[..., :-1]  # number k is between pixels k and k + 1
    near = torch.arange(-reach - 1, reach + 1, device=row.device)
    index = (column.unsqueeze(-1) + near).clamp(0, width - 2)
    steepest = step.gather(-1, index.flatten(-2)).view(index.shape).abs().argmax(-1, keepdim=True)
    edge = index.gather(-1, steepest)
    index = (edge + torch.arange(-BLUR, BLUR + 1, device=row.device)).clamp(0, width - 2)
    steps = step.gather(-1, index.flatten(-2)).view(index.shape)
    # Only what steps in the same direction belongs to it.
    weight = (steps * step.gather(-1, edge.squeeze(-1)).sign().unsqueeze(-1)).clamp_min(0)
    total = weight.sum(-1)
    place = (weight * (index - edge)).sum(-1) / total.clamp_min(torch.finfo(row.dtype).tiny)
    return (place + edge.squeeze(-1) + 0.5).clamp(1, width - 2)


def sample(row: Tensor, place: Tensor) -> Tensor:
    """The row `[..., W]` at fractions of pixels `[..., n, k]`, between neighbours by a straight line."""
    place = place.clamp(0, row.shape[-1] - 1)
    low = place.floor().clamp(max=row.shape[-1] - 2)
    number = low.to(torch.int64)
    left = row.gather(-1, number.flatten(-2)).view(number.shape)
    right = row.gather(-1, number.flatten(-2) + 1).view(number.shape)
    return torch.lerp(left, right, place - low)


def patch_error(left: Tensor, right: Tensor) -> Tensor:
    """Squared differences E of all pairs of patches `[..., n, 3], [..., m, 3] -> [..., n, m]`. [A eq. A.2]"""
    return (left.unsqueeze(-2) - right.unsqueeze(-3)).square().sum(-1)


def match_features(left: Features, right: Features, params: MatchParams | None = None) -> Matches:
    """For each left feature the right one with the smallest 3-pixel squared difference. [A eq. A.2]

    Only afterwards the disparity `d = left column - right column` must lie in its window: a window on the
    candidates would force false partners on features whose true partner is outside.
    """
    params = params or MatchParams()
    error = patch_error(left.patch, right.patch)
    error = error.masked_fill(~(left.valid.unsqueeze(-1) & right.valid.unsqueeze(-2)), math.inf)
    best, partner = error.min(-1)
    column = right.column.gather(-1, partner)
    disparity = left.column - column
    # Without a partner the error is infinite, which is below no limit.
    valid = (best < params.max_error) & (disparity > params.min_disparity_px) & (disparity < params.max_disparity_px)
    if params.one_to_one:
        owner = error.argmin(-2).gather(-1, partner)
        valid = valid & (owner == torch.arange(owner.shape[-1], device=owner.device))
    return Matches(left.column, column, best, valid)


class PredictionState(NamedTuple):
    """State of `PredictedFeatures`: the last and the last but one column of each feature, `[..., n]`."""

    last: Tensor
    before: Tensor


class PredictedFeatures(nn.Module):
    """Features of a row that prefer the object they were on, in place of `find_features`. [§2.1.4]

    Each feature is looked for within `reach` pixels of `2 last - before`, in the order of the slots; one whose
    largest |ND-min| there is below `min_motion` is lost, and its slot refilled with the strongest output of the
    whole row. It searches a few pixels instead of the row, and maps less densely, because features hop less.

    Shapes:
        row, motion `[..., T, W]` -> `Features` of `[..., T, n]`, in the order of the slots, not of strength.
        `state=None` starts with the strongest outputs of the first row.

    Args:
        params: as for `find_features`.
        reach: how far from the expected column a feature is looked for, pixels.

    Raises:
        InputError: row and motion of different shapes, or too narrow for so many features.
    """

    def __init__(self, params: FeatureParams | None = None, reach: int = 3) -> None:
        super().__init__()
        self.params, self.reach = params or FeatureParams(), reach

    def forward(
        self, row: Tensor, motion: Tensor, state: PredictionState | None = None
    ) -> tuple[Features, PredictionState]:
        check_width(row, motion, self.params)
        columns, strengths = [], []
        for sample in motion.unbind(-2):
            expected = None if state is None else 2 * state.last - state.before
            column, strength, new = pick(sample, self.params, expected, self.reach)
            # A new feature has no past: it is expected to stay.
            state = PredictionState(column, column if state is None else torch.where(new, column, state.last))
            columns.append(column)
            strengths.append(strength)
        assert state is not None
        return describe(row, torch.stack(columns, -2), torch.stack(strengths, -2), self.params), state
