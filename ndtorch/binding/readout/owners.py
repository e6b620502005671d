"""Read-out of the scale-free rule: which neurons stand for an object, from running statistics of the signals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.binding.feedback import settled
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.objects import ObjectTable
from ndtorch.errors import InputError
from ndtorch.vision.blocks import BLOCK_SECONDS, BlockLowPass, aligned
from ndtorch.vision.temporal import smoothing_factor, time_dim


class StatisticsState(NamedTuple):
    """State of `SignalStatistics`.

    Attributes:
        low: what the high-pass has taken for the mean, `[..., N]`.
        last: the latest high-passed sample, `[..., N]`.
        recent: the latest signals, a block of them, `[..., E, N]`, oldest first.
        covariance: running mean of the products of high-passed signals, `[..., N, N]`.
        roughness: the same of their differences from sample to sample, `[..., N, N]`.
        steps: samples taken, int64 scalar.
    """

    low: Tensor
    last: Tensor
    recent: Tensor
    covariance: Tensor
    roughness: Tensor
    steps: Tensor


class SignalStatistics(nn.Module):
    """Running covariance of signals and of their sample-to-sample differences.

    Everything that the read-out wants to know of outputs `o = X y` follows from that of y: their covariance is
    `X C X^T`, so one memory serves whatever the weights are now.

    Args:
        dt: time step in seconds.
        tau: memory, seconds.
        tau_high: high-pass on the signals, seconds.

    Shapes:
        signals `[..., T, N]` -> state, up to the last whole tenth of a second. `None` starts at rest, with zeros.
    """

    def __init__(self, dt: float = 0.01, tau: float = 5.0, tau_high: float = 2.0) -> None:
        super().__init__()
        self.every = max(1, round(BLOCK_SECONDS / dt))
        self.low_pass = BlockLowPass(smoothing_factor(tau_high, dt), self.every)
        self.mean = BlockLowPass(smoothing_factor(tau, dt), self.every)

    def forward(self, signals: Tensor, state: StatisticsState | None = None) -> StatisticsState:
        time_dim(signals, 1)
        if state is None:
            zeros = torch.zeros_like(signals[..., 0, :])
            square = zeros.unsqueeze(-1) * zeros.unsqueeze(-2)
            recent = zeros.unsqueeze(-2).expand(*zeros.shape[:-1], self.every, zeros.shape[-1])
            state = StatisticsState(zeros, zeros, recent, square, square, torch.zeros((), dtype=torch.int64))
        low, last, covariance, roughness = state.low, state.last, state.covariance, state.roughness
        first, length = int(state.steps), signals.shape[-2]
        samples = torch.cat([state.recent, signals], -2)
        for block in aligned(samples, length, first, self.every):
            lows = self.low_pass(block, low)
            low, high = lows[..., -1, :], block - lows
            change = torch.diff(high, dim=-2, prepend=last.unsqueeze(-2))
            last = high[..., -1, :]
            kept, taken = self.mean.weights(high)
            covariance = kept * covariance + (high * taken[:, None]).mT @ high
            roughness = kept * roughness + (change * taken[:, None]).mT @ change
        steps = torch.tensor(first + length, dtype=torch.int64)
        return StatisticsState(low, last, samples[..., length:, :], covariance, roughness, steps)


@dataclass(frozen=True)
class OwnerCriteria:
    """What an owner must be.

    Attributes:
        strength: its output's deviation, as a share of the largest of all outputs.
        kept: the same, as a share of its own input's deviation.
        faint: smallest deviation, where fluctuations of a group are around 1.
        rough: largest mean square of its output's differences from sample to sample, as a share of its power,
            for samples 10 ms apart; it grows with the time between samples.
        alike: largest correlation with a stronger owner.
        smallest: share of its group's largest from which on a feature belongs to it.
    """

    strength: float = 0.35
    kept: float = 0.55
    faint: float = 0.05
    rough: float = 0.15
    alike: float = 0.6
    smallest: float = 1 / 3


def owner_table(
    weights: Tensor, statistics: StatisticsState, criteria: OwnerCriteria | None = None, dt: float = 0.01
) -> ObjectTable:
    """The owners under the weights `[..., N, N]`, given the statistics of the network's inputs.

    Each group of an owner's features is over its largest, and small ones are removed.
    """
    c = criteria or OwnerCriteria()
    if weights.shape[-1] != 10:
        raise InputError(f"weights must be [..., 10, 10], got {tuple(weights.shape)}")
    passage = settled(weights)
    covariance = passage @ statistics.covariance @ passage.mT
    rough = (passage @ statistics.roughness @ passage.mT).diagonal(dim1=-2, dim2=-1)
    tiny = torch.finfo(weights.dtype).tiny
    power = covariance.diagonal(dim1=-2, dim2=-1).clamp_min(tiny)
    deviation = power.sqrt()
    given = statistics.covariance.diagonal(dim1=-2, dim2=-1).sqrt()
    candidates = (deviation >= c.strength * deviation.amax(-1, keepdim=True)) & (deviation >= c.kept * given)
    candidates &= (deviation >= c.faint) & (rough < c.rough * max(1.0, dt / 0.01) * power)
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
    shares = divide(positive, spread_groups(group_max(positive)))
    return torch.where(shares >= smallest, shares, 0.0)
