"""Read-out by delays of the sums as they are, before any normalisation: there, sources add up exactly.

Colors and orientations of the sums are a fixed mixture of the objects' brightness. The group normalisation divides them
by a maximum that changes with time, and motion holds the brightness times itself: both make further directions of the
signals that are no further objects. So colors and orientations alone are counted, without normalisation, and every
direction counts that stands out of the noise, however faint. Where they hold as many sources as they can tell apart,
motion is counted too. Motion then belongs to the sources that it goes along with.

Noise has a power in every direction: what the weakest directions hold is noise, and so is what the covariance without
delay holds more than the one with the shortest delay.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.binding.covariance import CovarianceState, RunningCovariances
from ndtorch.binding.feedback import settled
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.delays import DELAYS, Separation, assigned, diagonalise, without_lighting
from ndtorch.binding.readout.params import SourceCriteria, SumCriteria
from ndtorch.vision.features import GROUPS

LINEAR = slice(GROUPS["motion"].stop, None)
"""Signals that are proportional to brightness: orientations and colors."""
WEAKEST = 3
"""Directions that are taken for noise."""


def sum_statistics(
    dt: float = 0.01,
    delays: tuple[float, ...] = DELAYS,
    tau_recent: float = 0.75,
    tau_fast: float = 3.5,
    tau_slow: float = 12.0,
    tau_high: float = 2.0,
    every: float = 0.1,
) -> RunningCovariances:
    """What `sums_table` looks at: covariances of the sums with their own past in three memories.

    Args:
        dt: time step in seconds.
        delays: seconds, ascending.
        tau_recent, tau_fast, tau_slow: the memories, seconds; the first one tells what is still there.
        tau_high: high-pass on the sums, seconds.
        every: time between updates, seconds.
    """
    return RunningCovariances(
        dt, (tau_recent, tau_fast, tau_slow), (0.0, *delays), tau_high, every=every, at_first=True
    )


def sums_table(
    owners: ObjectTable,
    weights: Tensor,
    statistics: CovarianceState,
    first_stage: Tensor,
    criteria: SourceCriteria | None = None,
    limits: SumCriteria | None = None,
    smallest: float = 1 / 3,
) -> ObjectTable:
    """The objects: sources of the long memory that are still there, or of the short one if only that sees one leave.

    The network's table stays where it counts as many and two sources have the same delay profile.

    Args:
        owners: the owners' table.
        weights: of the network, `[..., 10, 10]`.
        statistics: state of `sum_statistics`.
        first_stage: weights of the first stage, `[10, 10]`.
        criteria, limits: what a source must have.
        smallest: share of its group's largest that makes a feature.
    """
    c, limit = criteria or SourceCriteria(), limits or SumCriteria()
    recent, fast, slow = statistics.covariances.unbind(-4)
    still = steady(statistics.low, recent, limit)
    short, gone = present_sources(fast, recent, first_stage, c, limit)
    long, left = present_sources(slow, recent, first_stage, c, limit)
    # What came and what left at once goes together in the long memory.
    left = gone & ~left & (short.sources < long.sources)
    chosen = Separation(*(choose(left, a, b) for a, b in zip(short, long, strict=True)))
    count = torch.where(still, 0, chosen.sources)
    by_network = owners.owners.sum(-1)
    keep = (chosen.gap < c.gap) & (by_network == count) & (count > 0)
    found = assigned(chosen.mixing, count, weights, smallest)
    return ObjectTable(
        torch.where(keep[..., None], owners.owners, found.owners),
        torch.where(keep[..., None, None], owners.rows, found.rows),
    )


def choose(where: Tensor, yes: Tensor, no: Tensor) -> Tensor:
    """`torch.where` for tensors of more dimensions than the condition."""
    return torch.where(where.reshape(where.shape + (1,) * (yes.ndim - where.ndim)), yes, no)


def steady(level: Tensor, covariances: Tensor, limits: SumCriteria) -> Tensor:
    """Whether orientations and colors fluctuate by less than `least` of their level, `[...]` bool."""
    deviation = covariances[..., 0, :, :].diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()
    fluctuates = group_max(deviation) > limits.least * group_max(level.abs())
    return ~fluctuates[..., 1:].any(-1)


def present_sources(
    covariances: Tensor, recent: Tensor, first_stage: Tensor, criteria: SourceCriteria, limits: SumCriteria
) -> tuple[Separation, Tensor]:
    """Sources in covariances `[..., L, 10, 10]` that are still in the recent ones, without lighting.

    Returns:
        What was found, through the settled first stage, and whether one had left, `[...]` bool.
    """
    scale = spread_groups(group_max(covariances[..., 0, :, :].diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()))
    unit = (scale.unsqueeze(-1) * scale.unsqueeze(-2)).unsqueeze(-3)
    normal, now = divide(covariances, unit).double(), divide(recent, unit).double()
    sources = sources_of(normal, criteria, limits)
    power = (sources.unmixing @ now[..., 1, :, :] @ sources.unmixing.mT).diagonal(dim1=-2, dim2=-1)
    rank = torch.arange(power.shape[-1], device=power.device)
    there = rank < sources.number.unsqueeze(-1)
    here = there & (power > limits.left)
    # Those that are here come first.
    order = torch.argsort((~here).long(), dim=-1, stable=True)
    mixing = sources.mixing.gather(-2, order.unsqueeze(-1).expand_as(sources.mixing))
    count = here.sum(-1)
    mixing = torch.where((rank < count.unsqueeze(-1)).unsqueeze(-1), mixing, 0.0)
    refined = mixing.to(covariances.dtype) @ settled(first_stage.to(covariances.dtype)).mT
    nothing = torch.zeros_like(count, dtype=torch.bool)
    found = Separation(count, refined, nothing, sources.gap.to(covariances.dtype))
    return without_lighting(found, first_stage, criteria), (there & ~here).any(-1)


class Sources(NamedTuple):
    """Sources in normalised covariances; S is the largest number asked for.

    Attributes:
        number: how many, `[...]`, int64.
        mixing: `[..., S, 10]`, unit power at the shortest delay, the largest entry positive.
        unmixing: `[..., S, 10]`, from signals to sources.
        gap: as in `Separation`.
    """

    number: Tensor
    mixing: Tensor
    unmixing: Tensor
    gap: Tensor


def sources_of(covariances: Tensor, criteria: SourceCriteria, limits: SumCriteria) -> Sources:
    """Count and mixing from covariances `[..., L, 10, 10]` in double precision, the first without delay."""
    batch, most = covariances.shape[:-3], criteria.most_sources
    flat = covariances.reshape(-1, *covariances.shape[-3:])
    linear = stands_out(flat[:, 0, LINEAR, LINEAR], flat[:, 1, LINEAR, LINEAR], limits.faintest, limits)
    every = stands_out(flat[:, 0], flat[:, 1], limits.crowded, limits)
    wide = crowded(flat[:, 0, LINEAR, LINEAR], flat[:, 1, LINEAR, LINEAR], limits) & (linear > 0)
    count = torch.where(wide, torch.maximum(linear, every), linear).clamp_max(most)
    mixing, unmixing = flat.new_zeros(len(flat), most, 10), flat.new_zeros(len(flat), most, 10)
    gap = flat.new_full((len(flat),), torch.inf)
    for m in range(1, most + 1):
        for part, all_of in ((slice(0, None), True), (LINEAR, False)):
            at = ((count == m) & (wide == all_of)).nonzero().squeeze(-1)
            if len(at) == 0:
                continue
            here = flat[at]
            values, vectors = torch.linalg.eigh(here[:, 1, part, part])
            basis, size = vectors[..., -m:], values[:, None, -m:].clamp_min(1e-12).sqrt()
            whiten = (basis / size).unsqueeze(1)
            rotation, rotated = diagonalise(
                whiten.mT @ here[:, 2:, part, part] @ whiten, criteria.sweeps, criteria.enough
            )
            apart = (basis / size @ rotation).mT
            mixed = (here[:, 1, :, part] @ apart.mT).mT
            sign = mixed.gather(-1, mixed.abs().argmax(-1, keepdim=True)).sign()
            mixing[at, :m] = mixed * sign
            full = torch.zeros(len(at), m, 10, dtype=flat.dtype)
            full[..., part] = apart * sign
            unmixing[at, :m] = full
            if m > 1:
                profile = rotated.diagonal(dim1=-2, dim2=-1)
                squares = (profile.unsqueeze(-1) - profile.unsqueeze(-2)).square().sum(1)
                squares = squares + torch.diag_embed(squares.new_full((m,), torch.inf))
                gap[at] = squares.amin((-1, -2))
    return Sources(
        count.reshape(batch),
        mixing.reshape(*batch, most, 10),
        unmixing.reshape(*batch, most, 10),
        gap.reshape(batch),
    )


def stands_out(without: Tensor, delayed: Tensor, share: float, limits: SumCriteria) -> Tensor:
    """How many directions of the covariance at the shortest delay `[B, N, N]` stand out of the noise, `[B]`."""
    values = torch.linalg.eigvalsh(delayed)
    top = values[:, -1]
    # What is left of noise with a delay, and what noise there is without.
    colored = values[:, :WEAKEST].abs().mean(-1)
    white = torch.linalg.eigvalsh(without)[:, :WEAKEST].mean(-1)
    least = torch.stack([share * top, limits.colored * colored, limits.white * white]).amax(0)
    count = (values > least.unsqueeze(-1)).sum(-1)
    return torch.where(top > limits.clear * colored, count, 0)


def crowded(without: Tensor, delayed: Tensor, limits: SumCriteria) -> Tensor:
    """Whether orientations and colors hold `crowd` sources at least, which leaves few directions to noise, `[B]`."""
    values = torch.linalg.eigvalsh(delayed)
    white = torch.linalg.eigvalsh(without)[:, 0]
    least = torch.stack([limits.faintest * values[:, -1], limits.apart * values[:, 0].abs(), limits.white * white])
    crowd: Tensor = values[:, -limits.crowd] > least.amax(0)
    return crowd
