"""Owners of features from the learned weights and the covariances of signals, and the criteria of all read-outs."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.arguments import check_tensor
from ndtorch.binding.covariance import CovarianceState, RunningCovariances
from ndtorch.binding.learning import settled
from ndtorch.binding.normalise import group_max, over_groups
from ndtorch.binding.objects import ObjectTable
from ndtorch.config import Constants, constant
from ndtorch.errors import InputError


class OwnerCriteria(Constants):
    """What an owner must be."""

    strength: float = constant(0.35, "owner: its deviation as a share of the largest,", ge=0)
    kept: float = constant(0.55, "and of its own input's,", ge=0)
    faint: float = constant(0.05, "and its smallest, where fluctuations of a group are around 1,", ge=0)
    rough: float = constant(0.15, "its largest roughness (of samples 10 ms apart),", ge=0)
    alike: float = constant(0.6, "and largest correlation with a stronger owner", ge=-1, le=1)
    smallest: float = constant(1 / 3, "share of its group's largest that makes a feature", ge=0)


class SourceCriteria(Constants):
    """When sources found by delays are believed, and how they are looked for."""

    most_sources: int = constant(6, "largest number of sources", gt=0, le=10)
    gap: float = constant(0.02, "difference of delay profiles that tells two sources apart", ge=0)
    even: float = constant(0.65, "evenness of colors and orientations of light that changes everywhere,", ge=0)
    moving: float = constant(0.35, "if it has less than this share of the largest motion", ge=0)
    absent: float = constant(0.1, "and no color or orientation is one below this share of its largest", ge=0)
    sweeps: int = constant(12, "rounds of rotations at most,", gt=0)
    enough: float = constant(1e-6, "and their largest angle in radians that ends them", ge=0)


class SumCriteria(Constants):
    """When a direction of the sums holds a source: eigenvalues of the covariance at the shortest delay."""

    faintest: float = constant(3e-4, "share of the largest, of orientations and colors,", ge=0)
    crowd: int = constant(4, "from so many sources on motion is counted too,", gt=0, le=6)
    apart: float = constant(4.0, "the last of these against the weakest direction,", ge=0)
    alone: float = constant(30.0, "or the weakest but one against the weakest, if that is quiet,", ge=1)
    least_alone: float = constant(1e-4, "with this share of the largest; the third weakest likewise,", ge=0)
    crowded: float = constant(0.0065, "share of the largest where motion is counted,", ge=0)
    colored: float = constant(2.3, "and more than this times the mean of the three weakest,", ge=0)
    white: float = constant(0.25, "and this share of the same without delay", ge=0)
    clear: float = constant(4.0, "the largest against the three weakest, or all is noise", ge=0)
    left: float = constant(0.1, "power lately against that of its memory, of what has left", ge=0)
    quick: float = constant(0.3, "share that changes in a delay, of what must not only decay lately", ge=0)
    least: float = constant(0.01, "deviation against the level, or nothing fluctuates", ge=0)
    doubtful: float = constant(2e-3, "share of the largest of a further source beside two of one rate", ge=0)
    lit: float = constant(0.012, "sine of the angle between even light and the sources: it is one,", ge=0)
    unmoved: float = constant(0.1, "if its share of the largest motion is below this", ge=0)
    moved: float = constant(0.115, "share of the largest motion without a source that makes one more,", ge=0)
    elsewhere: float = constant(0.03, "the same another way than all sources move,", ge=0)
    quiet: float = constant(5e-4, "where noise is less than this share of the largest", ge=0)
    covered: float = constant(
        8.0, "times the median, in a second, of what orientations hold beside colors: it is left out,", ge=1
    )
    beside: float = constant(3e-4, "if this is more than so large a share of the orientations", ge=0)
    motion_residual: float = constant(
        0.015, "share of motion beside products of colors where sources are more than colors", ge=0
    )
    quietest: float = constant(0.5, "share of the seconds with least beside the colors,", gt=0, le=1)
    lasting: float = constant(0.85, "in which a source holds this share of what it holds in all,", ge=0)
    least_lasting: float = constant(3e-6, "and this share of the orientations;", ge=0)
    same_color_residual: float = constant(0.035, "the same beside sources of one or two colors", ge=0)
    surprise: float = constant(40.0, "times more power than known that makes a new scene,", gt=0)
    seen_for: float = constant(1.5, "which is believed when it was seen for this long", ge=0)


REFERENCE = 0.01
"""Seconds between samples at which roughness is stated; it grows with the time between samples."""


def signal_statistics(
    dt: float = 0.01, tau: float = 5.0, tau_high: float = 2.0, every: float = 0.1
) -> RunningCovariances:
    """What `owner_table` looks at: covariances of signals and of their differences from sample to sample.

    Everything that the read-out wants to know of outputs `o = X y` follows from that of y: their covariance is `X C
    X^T`, so one memory serves whatever the weights are now. All times are in seconds.
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
    order = strength.argsort(dim=-1, descending=True, stable=True)
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
