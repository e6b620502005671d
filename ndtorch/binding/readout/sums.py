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
from torch import Tensor, nn

from ndtorch.binding.covariance import Anew, CovarianceState, RunningCovariances
from ndtorch.binding.feedback import settled
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.delays import DELAYS, Separation, assigned, diagonalise, without_lighting
from ndtorch.binding.readout.params import SourceCriteria, SumCriteria
from ndtorch.errors import InputError
from ndtorch.vision.features import GROUPS

LINEAR = slice(GROUPS["motion"].stop, None)
"""Signals that are proportional to brightness: orientations and colors."""
FAINT = 1e-3
"""Power of a direction in which nothing is known, as a share of each group's largest."""
LIGHT_MOST = 4
"""Among more sources, of six signals, even light can be a mixture of them."""
WEAKEST = 3
"""Directions that are taken for noise."""


class SumState(NamedTuple):
    """State of `SumStatistics`: of all three memories, and of the one that begins anew with every scene."""

    all: CovarianceState
    scene: CovarianceState


class SumStatistics(nn.Module):
    """What `sums_table` looks at: covariances of the sums with their own past.

    The first of three memories tells what is still there, the second what has left, the third what objects are like. A
    fourth begins anew whenever something comes into view that has no part in what was known.

    Args:
        dt: time step in seconds.
        delays: seconds, ascending.
        tau_recent, tau_fast, tau_slow: the memories, seconds; the fourth is as long as the third.
        tau_high: high-pass on the sums, seconds.
        every: time between updates, seconds.
        most: of `surprise`; beyond that the fourth begins anew.

    Shapes:
        sums `[..., T, 10]` -> state. `None` starts at rest, with zeros.

    Raises:
        InputError: no delay, or one that is not positive.
    """

    def __init__(
        self,
        dt: float = 0.01,
        delays: tuple[float, ...] = DELAYS,
        tau_recent: float = 0.75,
        tau_fast: float = 3.5,
        tau_slow: float = 12.0,
        tau_high: float = 2.0,
        every: float = 0.1,
        most: float = 40.0,
    ) -> None:
        super().__init__()
        if not delays or not all(delay > 0 for delay in delays):
            raise InputError(f"delays must be positive seconds, got {delays}")
        lags, memories = (0.0, *delays), (tau_recent, tau_fast, tau_slow)
        self.all = RunningCovariances(dt, memories, lags, tau_high, every=every, at_first=True)
        anew = Anew(surprise, most)
        self.scene = RunningCovariances(dt, (tau_slow,), lags, tau_high, every=every, at_first=True, anew=anew)

    def forward(self, sums: Tensor, state: SumState | None = None) -> SumState:
        before = (None, None) if state is None else state
        return SumState(self.all(sums, before[0]), self.scene(sums, before[1]))


def surprise(known: Tensor, now: Tensor) -> Tensor:
    """Power of orientations and colors now over what is known of every direction, summed over directions, `[...]`.

    In a scene that stays this is about their number, 6. What comes into view has a direction of its own, in which next
    to nothing is known; what leaves has none.

    Args:
        known, now: covariances `[..., 10, 10]`.
    """
    scale = spread_groups(group_max(known.diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()))
    unit = scale.unsqueeze(-1) * scale.unsqueeze(-2)
    then, here = (divide(part, unit)[..., LINEAR, LINEAR] for part in (known, now))
    floor = FAINT * torch.eye(then.shape[-1], dtype=then.dtype, device=then.device)
    times: Tensor = (torch.linalg.inv(then + floor) * here).sum((-1, -2))
    return times


def sums_table(
    owners: ObjectTable,
    weights: Tensor,
    statistics: SumState,
    first_stage: Tensor,
    criteria: SourceCriteria | None = None,
    limits: SumCriteria | None = None,
    smallest: float = 1 / 3,
) -> ObjectTable:
    """The objects: sources of the long memory that are still there, or fewer if only a shorter one sees some leave.

    The network's table stays where it counts as many and two sources have the same delay profile.

    Args:
        owners: the owners' table.
        weights: of the network, `[..., 10, 10]`.
        statistics: state of `SumStatistics`.
        first_stage: weights of the first stage, `[10, 10]`.
        criteria, limits: what a source must have.
        smallest: share of its group's largest that makes a feature.
    """
    c, limit = criteria or SourceCriteria(), limits or SumCriteria()
    recent, fast, slow = statistics.all.covariances.unbind(-4)
    still = steady(statistics.all.low, recent, limit)
    short, gone = present_sources(fast, recent, first_stage, c, limit)
    long, left = present_sources(slow, recent, first_stage, c, limit)
    scene, _ = present_sources(statistics.scene.covariances[..., 0, :, :, :], recent, first_stage, c, limit)
    left = gone & ~left & (short.sources < long.sources)
    chosen = Separation(*(choose(left, a, b) for a, b in zip(short, long, strict=True)))
    # What came and what left at once goes together in memories of both.
    changed = (scene.sources < chosen.sources) & (statistics.scene.age > limit.seen_for)
    chosen = Separation(*(choose(changed, a, b) for a, b in zip(scene, chosen, strict=True)))
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
    found = Separation(count, refined, sources.gap.to(covariances.dtype))
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
    """Count and mixing from covariances `[..., L, 10, 10]` in double precision, the first without delay.

    Light that changes everywhere is left out.
    """
    batch, most = covariances.shape[:-3], criteria.most_sources
    flat = covariances.reshape(-1, *covariances.shape[-3:])
    linear = stands_out(flat[:, 0, LINEAR, LINEAR], flat[:, 1, LINEAR, LINEAR], limits.faintest, limits)
    every = stands_out(flat[:, 0], flat[:, 1], limits.crowded, limits)
    light = even_light(flat[:, 1], linear, limits)
    lit = light.abs().amax(-1) > 0
    wide = crowded(flat[:, 0, LINEAR, LINEAR], flat[:, 1, LINEAR, LINEAR], limits) & (linear > 0) & ~lit
    count = torch.where(wide, torch.maximum(linear, every), linear)
    more = unexplained(flat[:, 0], flat[:, 1], count, limits) & ~lit
    wide, count = wide | more, (count + more.long()).clamp_max(most)
    found = unmixed(flat, count, wide, light, criteria)
    # Beside two of one rate, what is faint is an overtone of theirs: a shadow's edge does not dim all sums alike.
    values = torch.linalg.eigvalsh(flat[:, 1, LINEAR, LINEAR])
    fewer = (values > limits.doubtful * values[:, -1:]).sum(-1)
    again = (found.gap < criteria.gap) & ~wide & ~lit & (fewer < count) & (fewer > 1)
    if bool(again.any()):
        other = unmixed(flat, torch.where(again, fewer, count), wide, light, criteria)
        found = Sources(*(choose(again, a, b) for a, b in zip(other, found, strict=True)))
    return Sources(*(part.reshape((*batch, *part.shape[1:])) for part in found))


def unmixed(flat: Tensor, count: Tensor, wide: Tensor, light: Tensor, criteria: SourceCriteria) -> Sources:
    """So many sources of covariances `[B, L, 10, 10]`, one of which is left out if it is `light` `[B, 6]`.

    Args:
        flat: covariances, the first without delay.
        count: how many, `[B]`, light included.
        wide: whether motion tells them apart too, `[B]` bool.
        light: as of `even_light`.
        criteria: for the rotations.
    """
    most, lit = criteria.most_sources, light.abs().amax(-1) > 0
    mixing, unmixing = flat.new_zeros(len(flat), most, 10), flat.new_zeros(len(flat), most, 10)
    gap = flat.new_full((len(flat),), torch.inf)
    for m in range(1, most + 1):
        for part, kind in ((slice(0, None), wide & ~lit), (LINEAR, ~wide & ~lit), (LINEAR, lit)):
            at = ((count == m) & kind).nonzero().squeeze(-1)
            if len(at) == 0:
                continue
            here, n = flat[at], m
            values, vectors = torch.linalg.eigh(here[:, 1, part, part])
            white = vectors[..., -m:] / values[:, None, -m:].clamp_min(1e-12).sqrt()
            if bool(lit[at[0]]):
                white, n = without(white, light[at]), m - 1
            if n == 0:
                continue
            turned = white.unsqueeze(1)
            rotation, rotated = diagonalise(
                turned.mT @ here[:, 2:, part, part] @ turned, criteria.sweeps, criteria.enough
            )
            apart = (white @ rotation).mT
            mixed = (here[:, 1, :, part] @ apart.mT).mT
            sign = mixed.gather(-1, mixed.abs().argmax(-1, keepdim=True)).sign()
            mixing[at, :n] = mixed * sign
            full = torch.zeros(len(at), n, 10, dtype=flat.dtype)
            full[..., part] = apart * sign
            unmixing[at, :n] = full
            if n > 1:
                profile = rotated.diagonal(dim1=-2, dim2=-1)
                squares = (profile.unsqueeze(-1) - profile.unsqueeze(-2)).square().sum(1)
                squares = squares + torch.diag_embed(squares.new_full((n,), torch.inf))
                gap[at] = squares.amin((-1, -2))
    return Sources(count - lit.long(), mixing, unmixing, gap)


def even_light(delayed: Tensor, count: Tensor, limits: SumCriteria) -> Tensor:
    """The direction of light that changes everywhere, if it is among the sources of covariances `[B, 10, 10]`.

    All colors change alike then, and all orientations, and nothing moves with them. A direction of such light lies in
    the space of the sources to the last digit, or not at all.

    Returns:
        Orientations and colors of it, of unit length, zeros where there is none, `[B, 6]`.
    """
    found = delayed.new_zeros(len(delayed), 6)
    plane = delayed.new_zeros(6, 2)
    plane[:3, 0] = plane[3:, 1] = 3**-0.5
    for m in range(1, LIGHT_MOST + 1):
        at = (count == m).nonzero().squeeze(-1)
        if len(at) == 0:
            continue
        values, vectors = torch.linalg.eigh(delayed[at][:, LINEAR, LINEAR])
        basis, size = vectors[..., -m:], values[:, None, -m:].clamp_min(1e-12)
        _, cosines, axes = torch.linalg.svd(basis.mT @ plane)
        light = (plane @ axes[:, 0, :, None]).squeeze(-1)
        away = (1 - cosines[:, 0].square()).clamp_min(0).sqrt()
        # What the source does by itself, and the motion that goes along with it.
        inside = basis.mT @ light.unsqueeze(-1)
        deviation = (inside / size.transpose(-1, -2).sqrt()).norm(dim=-2)
        unmix = (basis / size @ inside).squeeze(-1) / deviation
        motion = delayed[at][:, GROUPS["motion"], :]
        largest = motion[..., GROUPS["motion"]].diagonal(dim1=-2, dim2=-1).amax(-1).clamp_min(1e-12).sqrt()
        along = (motion[..., LINEAR] @ unmix.unsqueeze(-1)).squeeze(-1).abs().amax(-1)
        one_sign = axes[:, 0, 0] * axes[:, 0, 1] > -0.05
        there = (away < limits.lit) & ((along < limits.unmoved * largest) | (m == 1)) & one_sign
        found[at] = torch.where(there.unsqueeze(-1), light, 0.0)
    return found


def without(white: Tensor, light: Tensor) -> Tensor:
    """Whitening `[B, 6, m]` of the sources other than the one of direction `light` `[B, 6]`, `[B, 6, m - 1]`.

    In white coordinates sources are at right angles, so the others lie in the plane across the light.
    """
    axis = white.mT @ light.unsqueeze(-1)
    others: Tensor = white @ torch.linalg.svd(axis)[0][..., 1:]
    return others


def unexplained(plain: Tensor, delayed: Tensor, count: Tensor, limits: SumCriteria) -> Tensor:
    """Whether motion goes its own way, beside the sources of orientations and colors, `[B]`.

    Bars alike in color and orientation are one source of those, and two of motion. Motion holds brightness times
    itself, a little of which no source explains; and noise, beside which this is not asked.

    Args:
        plain, delayed: covariances without and at the shortest delay, `[B, 10, 10]`.
        count: of the sources, `[B]`.
        limits: see there.
    """
    found = torch.zeros(len(delayed), dtype=torch.bool)
    motion = GROUPS["motion"]
    for m in range(1, 6):
        at = (count == m).nonzero().squeeze(-1)
        if len(at) == 0:
            continue
        here = delayed[at]
        values, vectors = torch.linalg.eigh(here[:, LINEAR, LINEAR])
        white = vectors[..., -m:] / values[:, None, -m:].clamp_min(1e-12).sqrt()
        along = here[:, motion, LINEAR] @ white
        left = torch.linalg.eigvalsh(here[:, motion, motion] - along @ along.mT)[:, -1]
        at_once = torch.linalg.eigvalsh(plain[at][:, motion, motion] - along @ along.mT)[:, -1]
        largest = torch.linalg.eigvalsh(here[:, motion, motion])[:, -1]
        noise = torch.maximum(values[:, 0].abs(), torch.linalg.eigvalsh(plain[at][:, LINEAR, LINEAR])[:, 0])
        clean = noise < limits.quiet * values[:, -1]
        # White noise is gone after the delay.
        found[at] = clean & (left > limits.moved * largest) & (left > 0.5 * at_once)
    return found


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
