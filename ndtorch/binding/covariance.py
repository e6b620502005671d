"""Running covariances of signals with themselves, now and some time ago, in several memories: what read-outs look at.

One step is `covariance_step`, over a block of samples that always ends at the same times of a run, however the run is
cut into chunks: the sums are the same to the last bit.

The windows of `ndtorch.binding.object_files` take one sample at a time instead, with `sample_step`.
What a window sees next depends on where this sample has moved it, so there is no block to wait for; and each window has
a clock of its own: it begins anew when it opens, and takes in nothing while its object is out of sight.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_number, check_state, check_tensor, is_finite, rows_in
from ndtorch.errors import InputError
from ndtorch.vision.blocks import BlockLowPass, Stretch
from ndtorch.vision.temporal import smoothing_factor, time_dim


class CovarianceState(NamedTuple):
    """State of `RunningCovariances`: M memories, L delays.

    Attributes:
        low: what the high-pass has taken for the mean, `[..., N]`.
        past: the latest high-passed samples, as many as the longest delay, `[..., D, N]`, oldest first.
        recent: the latest signals, a block of them less one, `[..., E - 1, N]`, oldest first.
        covariances: running covariances, `[..., M, L, N, N]`.
        differences: running covariances of sample-to-sample differences, `[..., M, N, N]`; of no memory where they
            are not wanted.
        steps: samples taken, int64 scalar.
        age: seconds since the memories began or began anew, `[...]`; below 0 they still wait.
        pieces: sums, over updates, of the mean products in each of the latest P stretches of time, oldest first,
            `[..., P, L, N, N]`.
        held: updates in each of them, int64 `[P]`.
    """

    low: Tensor
    past: Tensor
    recent: Tensor
    covariances: Tensor
    differences: Tensor
    steps: Tensor
    age: Tensor
    pieces: Tensor
    held: Tensor


@dataclass(frozen=True)
class Anew:
    """When all memories begin anew: what is there now does not fit what they hold.

    Attributes:
        surprise: covariance of the last memory and of the latest block, `[..., N, N]` both -> how many times more
            power than expected the block has, `[...]`.
        most: of it; beyond that they begin anew.
        least: seconds of memory before they can.
        wait: seconds until they begin, while one scene gives way to the other.
    """

    surprise: Callable[[Tensor, Tensor], Tensor]
    most: float
    least: float = 4.0
    wait: float = 1.0


@dataclass(frozen=True)
class Constants:
    """What is fixed in a step.

    Attributes:
        lags: delays in time steps, ascending.
        longest: high-passed samples that are kept.
        low_pass: of the high-pass.
        memories: filters of the products.
        differences: whether differences are looked at.
        anew: when the memories begin anew; None for never.
        dt, tau: seconds, of a time step and of the last memory.
        pieces: how many.
        updates: in each of them.
        wait: seconds until the memories begin.
    """

    lags: tuple[int, ...]
    longest: int
    low_pass: BlockLowPass
    memories: tuple[BlockLowPass, ...]
    differences: bool
    anew: Anew | None
    dt: float
    tau: float
    pieces: int
    updates: int
    wait: float


class RunningCovariances(nn.Module):
    """Running covariances of high-passed signals with themselves at every delay, made symmetric, in every memory.

    Args:
        dt: time step in seconds.
        memories: time constants, seconds.
        delays: seconds; 0 is the covariance proper. Each becomes a whole number of time steps, at least one if it is
            not 0.
        tau_high: high-pass on the signals, seconds.
        differences: also keep the covariances of differences from sample to sample.
        every: time between updates, seconds.
        at_first: the high-pass starts settled on the first sample, for signals that are not around zero.
        anew: when all begins anew, which needs a covariance proper; None for never.
        pieces: how many of the latest stretches of time are kept apart too, for those who choose among them.
        piece: length of each, seconds.
        wait: seconds until all begins, for signals of filters that settle.

    Shapes:
        signals `[..., T, N]` -> state, up to the last update. `None` starts at rest, with zeros.

    Raises:
        InputError: no memory, no delay, or a negative delay.
    """

    def __init__(
        self,
        dt: float = 0.01,
        memories: tuple[float, ...] = (5.0,),
        delays: tuple[float, ...] = (0.0,),
        tau_high: float = 2.0,
        differences: bool = False,
        every: float = 0.1,
        at_first: bool = False,
        anew: Anew | None = None,
        pieces: int = 0,
        piece: float = 1.0,
        wait: float = 0.0,
    ) -> None:
        super().__init__()
        self.at_first = at_first
        if not memories:
            raise InputError("memories must be time constants in seconds, got none")
        check_number("dt", dt, above=0, unit="seconds")
        check_number("every", every, least=0, unit="seconds")
        if not delays or not all(is_finite(delay) and delay >= 0 for delay in delays):
            raise InputError(f"delays must be seconds >= 0, got {delays}")
        lags = tuple(sorted({rows_in("delays", delay, dt) if delay else 0 for delay in delays}))
        self.every = max(1, round(every / dt))
        self.low_pass = BlockLowPass(smoothing_factor(tau_high, dt), self.every)
        filters = tuple(BlockLowPass(smoothing_factor(tau, dt), self.every) for tau in memories)
        self.memories = nn.ModuleList(filters)
        self.constants = Constants(
            lags=lags,
            longest=max(lags[-1], 1 if differences else 0),
            low_pass=self.low_pass,
            memories=filters,
            differences=differences,
            anew=anew,
            dt=dt,
            tau=memories[-1],
            pieces=pieces,
            updates=max(1, round(piece / (self.every * dt))),
            wait=wait,
        )

    def start(self, first: Tensor) -> CovarianceState:
        """State at rest for signals like `first` `[..., N]`."""
        c, batch, n = self.constants, first.shape[:-1], first.shape[-1]
        # No tensor twice: an export would take the two for one for ever.
        return CovarianceState(
            low=first.clone() if self.at_first else torch.zeros_like(first),
            past=first.new_zeros(*batch, c.longest, n),
            recent=first.new_zeros(*batch, self.every - 1, n),
            covariances=first.new_zeros(*batch, len(c.memories), len(c.lags), n, n),
            differences=first.new_zeros(*batch, len(c.memories) if c.differences else 0, n, n),
            steps=torch.zeros((), dtype=torch.int64),
            age=first.new_full(batch, -c.wait),
            pieces=first.new_zeros(*batch, c.pieces, len(c.lags), n, n),
            held=torch.zeros(c.pieces, dtype=torch.int64),
        )

    def forward(self, signals: Tensor, state: CovarianceState | None = None) -> CovarianceState:
        check_state(state, CovarianceState)
        time_dim(signals, 1, "signals")
        check_tensor("signals", signals)
        now = state = self.start(signals[..., 0, :]) if state is None else state
        stretch = Stretch(state.recent, signals, state.steps, self.every, -2)
        for block, whole in zip(stretch.blocks, stretch.whole, strict=True):
            after = covariance_step(block, now, self.constants)
            if whole is not None:
                # An exported program cannot skip a block that is not whole yet: it takes nothing from it.
                after = CovarianceState(*(torch.where(whole, a, b) for a, b in zip(after, now, strict=True)))
            now = after
        return now._replace(recent=stretch.recent, steps=state.steps + signals.shape[-2])


def covariance_step(block: Tensor, state: CovarianceState, constants: Constants) -> CovarianceState:
    """The covariances after one more block of signals `[..., E, N]`; `recent` and `steps` stay as they are."""
    c, steps = constants, block.shape[-2]
    lows = c.low_pass(block, state.low)
    high = block - lows
    known = torch.cat([state.past, high], -2)
    before = torch.stack([known.narrow(-2, c.longest - lag, steps) for lag in c.lags], -3)
    weights = [memory.weights(high) for memory in c.memories]
    pieces, held = state.pieces, state.held
    if c.pieces:
        over = held[-1] >= c.updates
        pieces = torch.where(
            over, torch.cat([pieces[..., 1:, :, :, :], torch.zeros_like(pieces[..., :1, :, :, :])], -4), pieces
        )
        held = torch.where(over, torch.cat([held[1:], torch.zeros_like(held[:1])]), held)
        now = symmetric(high.unsqueeze(-3).mT @ before) / steps
        pieces = torch.cat([pieces[..., :-1, :, :, :], pieces[..., -1:, :, :, :] + now.unsqueeze(-4)], -4)
        held = torch.cat([held[:-1], held[-1:] + 1])
    covariances = [
        kept * old + symmetric((high.unsqueeze(-3) * taken[:, None]).mT @ before)
        for (kept, taken), old in zip(weights, state.covariances.unbind(-4), strict=True)
    ]
    differences = state.differences
    if c.differences:
        change = high - known.narrow(-2, c.longest - 1, steps)
        squares = [
            kept * old + (change * taken[:, None]).mT @ change
            for (kept, taken), old in zip(weights, differences.unbind(-3), strict=True)
        ]
        differences = torch.stack(squares, -3)
    after = state._replace(
        low=lows[..., -1, :],
        past=known.narrow(-2, steps, c.longest),
        covariances=torch.stack(covariances, -4),
        differences=differences,
        age=state.age + steps * c.dt,
        pieces=pieces,
        held=held,
    )
    if c.anew is not None:
        return begun_anew(after, state, block, high, c, c.anew)
    return waiting(after, block) if c.wait else after


def begun_anew(
    after: CovarianceState, before: CovarianceState, block: Tensor, high: Tensor, constants: Constants, anew: Anew
) -> CovarianceState:
    """The state after a block, at rest where it does not fit the memories before it, and while they wait."""
    held = 1 - torch.exp(-before.age.clamp_min(0) / constants.tau)
    known = before.covariances[..., -1, 0, :, :] / held.clamp_min(1e-6)[..., None, None]
    now = high.mT @ high / high.shape[-2]
    other = (before.age > anew.least) & (anew.surprise(known, now) > anew.most)
    return waiting(after._replace(age=torch.where(other, -anew.wait, after.age)), block)


def waiting(after: CovarianceState, block: Tensor) -> CovarianceState:
    """The state after a block, at rest where its memories have not begun."""
    waits = after.age < 0

    def at_rest(value: Tensor) -> Tensor:
        return torch.where(waits.reshape(waits.shape + (1,) * (value.ndim - waits.ndim)), 0.0, value)

    return after._replace(
        # Until all is as it will be, nothing is a fluctuation.
        low=torch.where(waits.unsqueeze(-1), block[..., -1, :], after.low),
        past=at_rest(after.past),
        covariances=at_rest(after.covariances),
        differences=at_rest(after.differences),
        pieces=at_rest(after.pieces),
    )


def sample_step(
    sample: Tensor, mean: Tensor, covariance: Tensor, fresh: Tensor, a_high: float, share: float | Tensor
) -> tuple[Tensor, Tensor]:
    """Mean `[..., N]` and covariance `[..., N, N]` after one more sample, of which they take in the shares `a_high` and
    `share`; where `fresh`, the mean begins at the sample.
    """
    mean = torch.where(fresh, sample, torch.lerp(mean, sample, a_high))
    high = sample - mean
    return mean, covariance + share * (high.unsqueeze(-1) * high.unsqueeze(-2) - covariance)


def symmetric(matrices: Tensor) -> Tensor:
    """`(M + M^T) / 2`."""
    return (matrices + matrices.mT) / 2
