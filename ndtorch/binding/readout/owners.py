"""Read-out of the scale-free rule: which neurons stand for an object, from running statistics of the signals."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.covariance import CovarianceState, RunningCovariances
from ndtorch.binding.feedback import settled
from ndtorch.binding.normalise import group_max, over_groups
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.params import OwnerCriteria
from ndtorch.errors import InputError

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
