"""Read-out by delays of the sums as they are, before any normalisation: there, sources add up exactly.

Colors and orientations of the sums are a fixed mixture of the objects' brightness. The group normalisation divides them
by a maximum that changes with time, and motion holds the brightness times itself: both make further directions of the
signals that are no further objects. So colors and orientations alone are counted, without normalisation, and every
direction counts that stands out of the noise, however faint. Where they hold as many sources as they can tell apart,
motion is counted too. Motion then belongs to the sources that it goes along with.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_state
from ndtorch.binding.covariance import Anew, CovarianceState, RunningCovariances
from ndtorch.binding.learning import settled
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.joint_diagonalisation import (
    DELAYS,
    Separation,
    assigned,
    choose,
    sources_of,
    split,
    without_lighting,
)
from ndtorch.binding.readout.owners import SourceCriteria, SumCriteria
from ndtorch.binding.readout.source_count import LINEAR, Bound, motion_residual, source_bound, undisturbed
from ndtorch.errors import InputError
from ndtorch.vision.features import GROUPS
from ndtorch.vision.temporal import FilterState, LowPass

FAINT = 1e-3
"""Power of a direction in which nothing is known, as a share of each group's largest."""
SETTLED = 3.0
"""Seconds from the first frame until motion is that of the bars alone: six time constants of its high-pass."""


class SumState(NamedTuple):
    """State of `SumStatistics`: of all three memories, of the one that begins anew with every scene, and of motion
    beside products of colors, with the colors' delay filter."""

    all: CovarianceState
    scene: CovarianceState
    products: CovarianceState
    delayed: FilterState


class SumStatistics(nn.Module):
    """What `sums_table` looks at: covariances of the sums with their own past.

    The first of three memories tells what is still there, the second what has left, the third what objects are like. A
    fourth begins anew whenever something comes into view that has no part in what was known. The third is kept
    second by second, so that those in which bars come near each other can be left out (`undisturbed`).

    Args:
        dt: time step in seconds.
        delays: seconds, ascending.
        tau_recent, tau_fast, tau_slow: the memories, seconds; the fourth is as long as the third.
        tau_high: high-pass on the sums, seconds.
        every: time between updates, seconds.
        most: of `surprise`; beyond that the fourth begins anew.
        pieces: how many stretches of time the third memory consists of,
        piece: and how long each is, seconds.
        tau_delay: of the motion detectors, seconds.

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
        pieces: int = 24,
        piece: float = 1.0,
        tau_delay: float = 0.05,
    ) -> None:
        super().__init__()
        if not delays or not all(delay > 0 for delay in delays):
            raise InputError(f"delays must be positive seconds, got {delays}")
        lags = (0.0, *delays)
        self.all = RunningCovariances(
            dt, (tau_recent, tau_fast), lags, tau_high, every=every, at_first=True, pieces=pieces, piece=piece
        )
        anew = Anew(surprise, most)
        self.scene = RunningCovariances(dt, (tau_slow,), lags, tau_high, every=every, at_first=True, anew=anew)
        self.delay = LowPass(tau_delay, dt, 1)
        self.products = RunningCovariances(
            dt, (2 * tau_slow,), lags[1:2], tau_high, every=every, at_first=True, wait=SETTLED
        )

    def forward(self, sums: Tensor, state: SumState | None = None) -> SumState:
        check_state(state, SumState)
        before: Any = (None,) * 4 if state is None else state
        colors = sums[..., GROUPS["color"]]
        delayed, low = self.delay(colors, before[3])
        products = (colors.unsqueeze(-1) * delayed.unsqueeze(-2)).flatten(-2)
        known = torch.cat([sums[..., GROUPS["motion"]], colors, delayed, products], -1)
        return SumState(self.all(sums, before[0]), self.scene(sums, before[1]), self.products(known, before[2]), low)


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


class Answer(NamedTuple):
    """Objects of one moment.

    Attributes:
        table: the objects.
        changed: whether sources have just left or given way to others, `[...]` bool.
        doubt: whether one of them may be two in step, `[...]` bool.
    """

    table: ObjectTable
    changed: Tensor
    doubt: Tensor


def sums_table(
    owners: ObjectTable,
    weights: Tensor,
    statistics: SumState,
    first_stage: Tensor,
    criteria: SourceCriteria | None = None,
    limits: SumCriteria | None = None,
    smallest: float = 1 / 3,
    tau: float = 12.0,
    piece: float = 1.0,
    bound: Bound | None = None,
) -> Answer:
    """The objects: sources of the long memory that are still there, or fewer if only a shorter one sees some leave.

    The network's table stays where it counts as many and two sources have the same delay profile. `smallest` is the
    share of its group's largest that makes a feature, `bound` that of the number, if it is known already.
    """
    c, limit = criteria or SourceCriteria(), limits or SumCriteria()
    recent, fast = statistics.all.covariances.unbind(-4)
    slow = undisturbed(statistics.all, tau, piece, limit)
    if bound is None:
        bound = source_bound(statistics.all, motion_residual(statistics.products), limit)
    still = steady(statistics.all.low, recent, limit)
    short, gone = present_sources(fast, recent, first_stage, c, limit, bound)
    long, lost = present_sources(slow, recent, first_stage, c, limit, bound)
    scene, _ = present_sources(statistics.scene.covariances[..., 0, :, :, :], recent, first_stage, c, limit, bound)
    left = gone & ~lost & (short.sources < long.sources)
    chosen = Separation(*(choose(left, a, b) for a, b in zip(short, long, strict=True)))
    # What came and what left at once goes together in memories of both.
    changed = (scene.sources < chosen.sources) & (statistics.scene.age > limit.seen_for)
    chosen = Separation(*(choose(changed, a, b) for a, b in zip(scene, chosen, strict=True)))
    # A memory of two scenes separates neither, and one that has just begun hardly does.
    two, doubt, apart = split(long, first_stage, c, limit.doubtful)
    also, *_ = split(scene, first_stage, c, limit.doubtful)
    two = two & (also | (statistics.scene.age < limit.seen_for))
    chosen = Separation(*(choose(two, a, b) for a, b in zip(apart, chosen, strict=True)))
    count = torch.where(still, 0, chosen.sources)
    by_network = owners.owners.sum(-1)
    keep = (chosen.gap < c.gap) & (by_network == count) & (count > 0)
    found = assigned(chosen.mixing, count, weights, smallest)
    table = ObjectTable(
        torch.where(keep[..., None], owners.owners, found.owners),
        torch.where(keep[..., None, None], owners.rows, found.rows),
    )
    return Answer(table, (left | lost | changed) & ~two, doubt)


def steady(level: Tensor, covariances: Tensor, limits: SumCriteria) -> Tensor:
    """Whether orientations and colors fluctuate by less than `least` of their level, `[...]` bool."""
    deviation = covariances[..., 0, :, :].diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()
    fluctuates = group_max(deviation) > limits.least * group_max(level.abs())
    return ~fluctuates[..., 1:].any(-1)


def changing(unmixing: Tensor, covariances: Tensor) -> Tensor:
    """Power of what sources change in the time of a delay, the mean over delays, `[..., S]`.

    The high-pass settles for seconds after an object has left: that decays, and is below 0.
    """
    change = covariances[..., 1, :, :] - covariances[..., 2:, :, :].mean(-3)
    return (unmixing @ change @ unmixing.mT).diagonal(dim1=-2, dim2=-1)


def present_sources(
    covariances: Tensor,
    recent: Tensor,
    first_stage: Tensor,
    criteria: SourceCriteria,
    limits: SumCriteria,
    bound: Bound,
) -> tuple[Separation, Tensor]:
    """Sources in covariances `[..., L, 10, 10]`, within `bound`, that are still in the recent ones, without lighting,
    through the settled first stage; and whether one had left, `[...]` bool.
    """
    scale = spread_groups(group_max(covariances[..., 0, :, :].diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()))
    unit = (scale.unsqueeze(-1) * scale.unsqueeze(-2)).unsqueeze(-3)
    normal, now = divide(covariances, unit).double(), divide(recent, unit).double()
    sources = sources_of(normal, criteria, limits, bound)
    power = (sources.unmixing @ now[..., 1, :, :] @ sources.unmixing.mT).diagonal(dim1=-2, dim2=-1)
    rank = torch.arange(power.shape[-1], device=power.device)
    there = rank < sources.number.unsqueeze(-1)
    quick = changing(sources.unmixing, normal) > limits.quick
    here = there & (power > limits.left) & ((changing(sources.unmixing, now) > 0) | ~quick)
    # Those that are here come first.
    order = torch.argsort((~here).long(), dim=-1, stable=True)
    mixing = sources.mixing.gather(-2, order.unsqueeze(-1).expand_as(sources.mixing))
    count = here.sum(-1)
    mixing = torch.where((rank < count.unsqueeze(-1)).unsqueeze(-1), mixing, 0.0)
    refined = mixing.to(covariances.dtype) @ settled(first_stage.to(covariances.dtype)).mT
    found = Separation(count, refined, sources.gap.to(covariances.dtype))
    return without_lighting(found, first_stage, criteria), (there & ~here).any(-1)
