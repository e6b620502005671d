"""Visual features of a row: the places where the image moves most."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError


@dataclass(frozen=True)
class FeatureParams:
    """What makes a feature. [A Methods]

    Args:
        count: This number of features is looked for, n; 4 to 7 are equally good.
        spacing_px: Features lie more than this far apart, D_min.
        min_motion: A feature has at least this raw ND-min output, T_min, for intensities 0..1.
        min_difference: Two features of a row whose patches differ by less than this are both dropped, T_sim.
        edge_reach_px: A feature is moved to the steepest step of brightness within this distance, to a fraction of a
            pixel; 0 leaves it where the motion is largest, as published. See `edge_places`.
        shared: Features are looked for only where the other camera can see the same at
            `MatchParams.min_disparity_px`, which leaves out the outer border of both rows. Not in [A].
        follow_reach_px: A feature is followed within this distance of where its last two places point to; 0 looks for
            the strongest features of every frame anew, as published. See `PredictedFeatures`.
        ahead_count: This many of the features are reserved for what lies ahead, and looked for there first. Not in
            [A]: what moves most is usually texture at the side. Features that are followed are not reserved.

    Raises:
        InputError: A number is out of range.
    """

    count: int = 5
    spacing_px: int = 3
    min_motion: float = 0.01
    min_difference: float = 0.008
    edge_reach_px: int = 0
    shared: bool = False
    follow_reach_px: int = 0
    ahead_count: int = 0

    def __post_init__(self) -> None:
        check_numbers(self, positive=("count",))
        if self.ahead_count > self.count:
            raise InputError(f"ahead_count must lie between 0 and count, got {self.ahead_count} of {self.count}")


class Features(NamedTuple):
    """Features of rows, strongest first; n slots, of which `valid` tells the good ones.

    Attributes:
        column: `[..., n]`, 0 is the leftmost pixel; whole numbers, or fractions where features are edges.
        strength: `[..., n]`, |ND-min| there.
        patch: `[..., n, 3]`, the row's intensities at `column - 1 .. column + 1`, or at `EDGE_SIDES` of an edge.
        valid: `[..., n]`, bool. Slots that are not valid hold numbers without meaning.
    """

    column: Tensor
    strength: Tensor
    patch: Tensor
    valid: Tensor


def find_features(
    row: Tensor, motion: Tensor, params: FeatureParams | None = None, band: tuple[int, int] | None = None
) -> Features:
    """The n largest |ND-min| outputs of a row, each more than `spacing` pixels from the others. [A Methods]

    Then those that are too weak, or whose surroundings look like those of another feature of the row, lose
    their `valid`. The outermost pixel at either end cannot be a feature, because it has no 3-pixel patch.

    Args:
        row: intensities `[..., W]`.
        motion: ND-min outputs of that row, `[..., W]`, W >= 3.
        band: columns, from and up to, that see what lies ahead; the middle third by default.

    Raises:
        InputError: row and motion of different shapes, or W < 3.
    """
    params = params or FeatureParams()
    if row.shape != motion.shape or row.ndim < 1 or row.shape[-1] < 3:
        raise InputError(
            f"expected row and motion of one shape [..., W >= 3], got {tuple(row.shape)} and {tuple(motion.shape)}"
        )
    width = row.shape[-1]
    column, strength = strongest(
        motion, params.count, params.spacing_px, params.ahead_count, band or (width // 3, width - width // 3)
    )
    return describe(row, column, strength, params)


def strongest(
    motion: Tensor, count: int, spacing: int, ahead: int = 0, band: tuple[int, int] = (0, 0)
) -> tuple[Tensor, Tensor]:
    """Columns `[..., n]` and magnitudes `[..., n]` of the largest outputs, one after the other. [A Methods]

    The first `ahead` lie in columns `band[0]` up to `band[1]`, as long as anything moves there. Where a row is too
    short for `count` features the last ones have magnitude -1.
    """
    magnitude = searchable(motion)
    around = torch.arange(-spacing, spacing + 1, device=motion.device)
    columns, strengths = [], []
    inside = torch.arange(motion.shape[-1], device=motion.device)
    outside = (inside < band[0]) | (inside >= band[1])
    for k in range(count):
        strength, column = magnitude.max(-1, keepdim=True)
        if k < ahead:
            there, place = magnitude.masked_fill(outside, -1.0).max(-1, keepdim=True)
            strength, column = torch.where(there > 0, there, strength), torch.where(there > 0, place, column)
        columns.append(column)
        strengths.append(strength)
        if k + 1 < count:
            exclude(magnitude, column + around)
    return torch.cat(columns, -1), torch.cat(strengths, -1)


def searchable(motion: Tensor) -> Tensor:
    """A fresh |motion| whose outermost pixels are -1: they are never the largest."""
    magnitude = motion.abs()
    magnitude[..., :: motion.shape[-1] - 1] = -1.0
    return magnitude


def exclude(magnitude: Tensor, columns: Tensor) -> None:
    """Set `magnitude` `[..., W]` to -1 in place at `columns` `[..., k]`: nothing is found there again."""
    # Places beyond the border fall on the outermost pixels, which are -1 already.
    magnitude.scatter_(-1, columns.clamp(0, magnitude.shape[-1] - 1), -1.0)


def describe(row: Tensor, column: Tensor, strength: Tensor, params: FeatureParams) -> Features:
    """Cut the patches and drop weak and ambiguous features; the second half of `find_features`.

    Where features are moved to edges, two may meet at one: the weaker one is dropped.
    """
    count, width = column.shape[-1], row.shape[-1]
    crowded = width - 2 < count * (2 * params.spacing_px + 1)  # slots can be empty: see `strongest`
    if crowded:
        column = column.clamp(1, width - 2)
    if params.edge_reach_px:
        column = edge_places(row, column, params.edge_reach_px)
        patch = sample(row, column.unsqueeze(-1) + torch.tensor(EDGE_SIDES, dtype=row.dtype, device=row.device))
    else:
        around = torch.arange(-1, 2, device=row.device)
        patch = row.gather(-1, (column.unsqueeze(-1) + around).flatten(-2)).view(*column.shape, 3)
    valid = strength >= params.min_motion
    if count > 1:
        other = patch_error(patch, patch)
        other.diagonal(dim1=-2, dim2=-1).fill_(float("inf"))
        if crowded:
            other = other.masked_fill((strength < 0).unsqueeze(-2), float("inf"))
        if params.edge_reach_px:
            same = (column.unsqueeze(-1) - column.unsqueeze(-2)).abs() < SAME_EDGE
            weaker = strength.unsqueeze(-1) < strength.unsqueeze(-2)
            equal = strength.unsqueeze(-1) == strength.unsqueeze(-2)
            twin = (same & (weaker | equal.tril(-1))).any(-1)  # of two equals the later one
            other = other.masked_fill(twin.unsqueeze(-2), float("inf"))
            valid = valid & ~twin
        valid = valid & (other.amin(-1) >= params.min_difference)
    return Features(column, strength, patch, valid)


EDGE_SIDES = (-1.5, 0.0, 1.5)
"""Where the patch of an edge is sampled, pixels from the edge: on either side of its blur, and in its middle."""

SAME_EDGE = 1.5
"""Edges less than so many pixels apart are one."""

BLUR = 2
"""Pixels on either side over which the blur of an edge reaches."""


def edge_places(row: Tensor, column: Tensor, reach: int) -> Tensor:
    """Where the edges are that made the motion at `column` `[..., n]`, as fractions of pixels.

    An edge that sweeps over v pixels between two frames changes all of them, so that the largest |ND-min| lies
    anywhere in a band v wide, and in the two eyes at different places of it. The edge itself is now at one end
    of the band: the steepest step of `row` `[..., W]` within `reach` pixels. Its place is the centroid of the
    step over `BLUR` pixels on either side, which is exact for a step that pixels average.
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
