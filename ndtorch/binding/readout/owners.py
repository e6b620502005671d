"""Owners of features from the learned weights and the covariances of signals, and the criteria of all read-outs."""

from __future__ import annotations

import torch
from pydantic import Field
from torch import Tensor

from ndtorch.arguments import check_tensor
from ndtorch.binding.covariance import CovarianceState, RunningCovariances
from ndtorch.binding.learning import settled
from ndtorch.binding.normalise import group_max, over_groups
from ndtorch.binding.objects import ObjectTable
from ndtorch.config import Constants
from ndtorch.errors import InputError


class OwnerCriteria(Constants):
    """What an owner must be."""

    strength: float = Field(0.35, ge=0, description="owner: its deviation as a share of the largest,")
    kept: float = Field(0.55, ge=0, description="and of its own input's,")
    faint: float = Field(0.05, ge=0, description="and its smallest, where fluctuations of a group are around 1,")
    rough: float = Field(0.15, ge=0, description="its largest roughness (of samples 10 ms apart),")
    alike: float = Field(0.6, ge=-1, le=1, description="and largest correlation with a stronger owner")
    smallest: float = Field(1 / 3, ge=0, description="share of its group's largest that makes a feature")


class SourceCriteria(Constants):
    """When sources found by delays are believed, and how they are looked for."""

    most_sources: int = Field(6, gt=0, le=10, description="largest number of sources")
    gap: float = Field(0.02, ge=0, description="difference of delay profiles that tells two sources apart")
    even: float = Field(0.65, ge=0, description="evenness of colors and orientations of light that changes everywhere,")
    moving: float = Field(0.35, ge=0, description="if it has less than this share of the largest motion")
    absent: float = Field(0.1, ge=0, description="and no color or orientation is one below this share of its largest")
    sweeps: int = Field(12, gt=0, description="rounds of rotations at most,")
    enough: float = Field(1e-6, ge=0, description="and their largest angle in radians that ends them")


class SumCriteria(Constants):
    """When a direction of the sums holds a source: eigenvalues of the covariance at the shortest delay."""

    faintest: float = Field(3e-4, ge=0, description="share of the largest, of orientations and colors,")
    crowd: int = Field(4, gt=0, le=6, description="from so many sources on motion is counted too,")
    apart: float = Field(4.0, ge=0, description="the last of these against the weakest direction,")
    alone: float = Field(30.0, ge=1, description="or the weakest but one against the weakest, if that is quiet,")
    least_alone: float = Field(1e-4, ge=0, description="with this share of the largest; the third weakest likewise,")
    crowded: float = Field(0.0065, ge=0, description="share of the largest where motion is counted,")
    colored: float = Field(2.3, ge=0, description="and more than this times the mean of the three weakest,")
    white: float = Field(0.25, ge=0, description="and this share of the same without delay")
    clear: float = Field(4.0, ge=0, description="the largest against the three weakest, or all is noise")
    left: float = Field(0.1, ge=0, description="power lately against that of its memory, of what has left")
    least: float = Field(0.01, ge=0, description="deviation against the level, or nothing fluctuates")
    doubtful: float = Field(2e-3, ge=0, description="share of the largest of a further source beside two of one rate")
    lit: float = Field(0.012, ge=0, description="sine of the angle between even light and the sources: it is one,")
    unmoved: float = Field(0.1, ge=0, description="if its share of the largest motion is below this")
    moved: float = Field(0.115, ge=0, description="share of the largest motion without a source that makes one more,")
    elsewhere: float = Field(0.03, ge=0, description="the same another way than all sources move,")
    quiet: float = Field(5e-4, ge=0, description="where noise is less than this share of the largest")
    covered: float = Field(
        8.0, ge=1, description="times the median, in a second, of what orientations hold beside colors: it is left out,"
    )
    beside: float = Field(3e-4, ge=0, description="if this is more than so large a share of the orientations")
    motion_residual: float = Field(
        0.015, ge=0, description="share of motion beside products of colors where sources are more than colors"
    )
    quietest: float = Field(0.5, gt=0, le=1, description="share of the seconds with least beside the colors,")
    lasting: float = Field(0.85, ge=0, description="in which a source holds this share of what it holds in all,")
    least_lasting: float = Field(3e-6, ge=0, description="and this share of the orientations;")
    same_color_residual: float = Field(0.035, ge=0, description="the same beside sources of one or two colors")
    surprise: float = Field(40.0, gt=0, description="times more power than known that makes a new scene,")
    seen_for: float = Field(1.5, ge=0, description="which is believed when it was seen for this long")


REFERENCE = 0.01
"""Seconds between samples at which roughness is stated; it grows with the time between samples."""


def signal_statistics(
    dt: float = 0.01, tau: float = 5.0, tau_high: float = 2.0, every: float = 0.1
) -> RunningCovariances:
    """What `owner_table` looks at: covariances of signals and of their differences from sample to sample.

    Everything that the read-out wants to know of outputs `o = X y` follows from that of y: their covariance is
    `X C X^T`, so one memory serves whatever the weights are now.

    Args:
        dt: time step in seconds.
        tau: memory, seconds.
        tau_high: high-pass on the signals, seconds.
        every: time between updates, seconds.
    """
    return RunningCovariances(dt, (tau,), (0.0,), tau_high, differences=True, every=every)


def owner_table(
    weights: Tensor, statistics: CovarianceState, criteria: OwnerCriteria | None = None, dt: float = 0.01
) -> ObjectTable:
    """The owners under the weights `[..., N, N]`, given the `signal_statistics` of the network's inputs.

    Each group of an owner's features is over its largest, and small ones are removed.
    """
    c = criteria or OwnerCriteria()
    if weights.shape[-1] != 10:
        raise InputError(f"weights must be [..., 10, 10], got {tuple(weights.shape)}")
    passage, inputs = settled(weights), statistics.covariances[..., 0, 0, :, :]
    covariance = passage @ inputs @ passage.mT
    rough = (passage @ statistics.differences[..., 0, :, :] @ passage.mT).diagonal(dim1=-2, dim2=-1)
    tiny = torch.finfo(weights.dtype).tiny
    power = covariance.diagonal(dim1=-2, dim2=-1).clamp_min(tiny)
    deviation = power.sqrt()
    given = inputs.diagonal(dim1=-2, dim2=-1).sqrt()
    candidates = (deviation >= c.strength * deviation.amax(-1, keepdim=True)) & (deviation >= c.kept * given)
    candidates &= (deviation >= c.faint) & (rough < c.rough * max(1.0, dt / REFERENCE) * power)
    # Sources in opposite phase stay two: only what goes along with a stronger owner is a copy of it.
    correlation = covariance / (deviation.unsqueeze(-1) * deviation.unsqueeze(-2))
    owners = distinct(candidates, deviation, correlation >= c.alike)
    rows = features_by_group(weights.mT + torch.eye(10, dtype=weights.dtype, device=weights.device), c.smallest)
    return ObjectTable(owners, torch.where(owners.unsqueeze(-1), rows, 0.0))


def distinct(candidates: Tensor, strength: Tensor, alike: Tensor) -> Tensor:
    """Candidates, strongest first, that are not `alike` `[..., N, N]` to one taken before; bool `[..., N]`."""
    order = strength.argsort(-1, descending=True)
    taken = torch.zeros_like(candidates)
    for k in order.unbind(-1):
        here = torch.nn.functional.one_hot(k, candidates.shape[-1]).bool()
        row = (alike & here.unsqueeze(-1)).any(-2)
        free = ~(row & taken).any(-1, keepdim=True)
        taken = taken | (here & candidates & free)
    return taken


def features_by_group(values: Tensor, smallest: float = 1 / 3) -> Tensor:
    """Each group of features over its own largest, negative and small ones removed, `[..., 10]`."""
    positive = values.clamp_min(0)
    shares = over_groups(positive, group_max(positive))
    return torch.where(shares >= smallest, shares, 0.0)


SMALLEST_WEIGHT = 1 / 3
SMALLEST_COLUMN = 0.6


def simplified(weights: Tensor, smallest_weight: float = SMALLEST_WEIGHT) -> Tensor:
    """Weights `[..., N, N]` over the largest of them, those under `smallest_weight` removed. [C eq. 6-7]"""
    check_tensor("weights", weights)
    if weights.ndim < 2 or weights.shape[-1] != weights.shape[-2]:
        raise InputError(f"weights must be square matrices [..., N, N], got {tuple(weights.shape)}")
    largest = weights.amax((-1, -2), keepdim=True).clamp_min(torch.finfo(weights.dtype).tiny)
    normed = weights / largest
    return torch.where(normed >= smallest_weight, normed, 0.0)


def object_table(
    weights: Tensor, smallest_weight: float = SMALLEST_WEIGHT, smallest_column: float = SMALLEST_COLUMN
) -> ObjectTable:
    """Read the objects out of second-stage weights `[..., N, N]`. [C eq. 6-10]

    A neuron owns an object when the weights it sends, after normalisation to the largest weight and removal of
    those under `smallest_weight`, sum to more than `smallest_column`. All zero weights give no object.

    >>> weights = torch.zeros(10, 10)
    >>> weights[1, 7] = weights[4, 7] = 0.8  # from red to right and to 0°
    >>> object_table(weights).owners.nonzero().tolist()
    [[7]]
    """
    kept = simplified(weights, smallest_weight)
    owners = kept.sum(-2) > smallest_column
    own = torch.eye(weights.shape[-1], dtype=weights.dtype, device=weights.device)
    return ObjectTable(owners, torch.where(owners.unsqueeze(-1), kept.mT + own, 0.0))
