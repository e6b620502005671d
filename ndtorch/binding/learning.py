"""The step of an inhibitory network: feedback, learning, and whether it has converged."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from ndtorch.binding.rules import Rule
from ndtorch.vision.blocks import BlockLowPass
from ndtorch.vision.temporal import low_pass_step

Feedback = Literal["delayed", "settled"]
FEEDBACKS: tuple[Feedback, ...] = ("delayed", "settled")


def inhibit(drive: Tensor, weights: Tensor, outputs: Tensor) -> Tensor:
    """One step of delayed feedback, `o(t + dt) = i'(t) - W o(t)`: `[..., N]`, `[..., N, N]`, `[..., N]`. [B eq. 22]"""
    if drive.ndim == 1 and weights.ndim == 2:
        return torch.addmv(drive, weights, outputs, alpha=-1)
    return drive - (weights @ outputs.unsqueeze(-1)).squeeze(-1)


def settled(weights: Tensor) -> Tensor:
    """The gain `(I + W)^-1`: what the network makes of a steady input, `[..., N, N]`. [C eq. 2]

    It is what `o(t + dt) = i - W o(t)` comes to rest at, so it needs no short time step. It exists: the spectral
    radius of |W| stays below 1, so -1 is no eigenvalue of W.
    """
    eye = torch.eye(weights.shape[-1], dtype=weights.dtype, device=weights.device)
    inverse: Tensor = torch.linalg.inv_ex(eye + weights)[0]
    return inverse


def through(block: Tensor, weights: Tensor, shared: bool) -> Tensor:
    """Settled outputs of a block of inputs `[..., E, N]`, or `[..., E, F, N]` of fields that share the weights."""
    gain = settled(weights).mT
    if not shared:
        return block @ gain
    return (block.flatten(-3, -2) @ gain).reshape(block.shape)


WhenFull = Literal["rescale", "stop"]


class NetworkState(NamedTuple):
    """Everything of the network that changes. Save it and the run can go on from there, bit for bit.

    Shapes are those of a network by itself; with `shared` weights, F fields have `[..., F, N]` for `[..., N]` in all
    but `fluctuation`.

    Attributes:
        weights: inhibition from neuron k to neuron n, `[..., N, N]`, diagonal zero.
        outputs: the latest outputs, `[..., N]`.
        input_low: what the input high-pass has taken for the mean, `[..., N]`.
        output_low: the same for the outputs in the learning rule, `[..., N]`.
        recent: the latest inputs since the last change of the weights and before, `[..., E - 1, N]`, oldest first.
        fluctuation: running mean of o'^2, summed over fields, `[..., N]`, if the rule looks at it.
        clock: time steps that the clock of the learning has run, `[...]`, float64.
        stopped: networks whose learning has ended, `[...]`, bool.
        mean_weights: running temporal mean of the weights, `[..., N, N]`.
        changes: summed magnitude of the changes of that mean at each recent change, `[..., S]`, oldest first.
        power: recent mean of squared outputs, `[..., N]`.
        roughness: recent mean of squared differences of successive outputs, `[..., N]`.
        steps: time steps taken since the start, int64 scalar.
    """

    weights: Tensor
    outputs: Tensor
    input_low: Tensor
    output_low: Tensor
    recent: Tensor
    fluctuation: Tensor
    clock: Tensor
    stopped: Tensor
    mean_weights: Tensor
    changes: Tensor
    power: Tensor
    roughness: Tensor
    steps: Tensor


@dataclass(frozen=True)
class Constants:
    """What is fixed in a step; see `InhibitoryNetwork`.

    Attributes:
        every: time steps between changes of the weights.
        output_low, mean_square: filters of the outputs and of the power of their fluctuations.
        a_mean: share of the new weights that their running mean takes in.
    """

    rule: Rule | None
    feedback: Feedback
    shared: bool
    dt: float
    every: int
    settle: float
    faint: float
    when_full: WhenFull
    output_low: BlockLowPass
    mean_square: BlockLowPass
    a_mean: float


class Moment(NamedTuple):
    """What depends on the time alone at a change of the weights.

    Attributes:
        factor: what the rule's change is multiplied by, `rate dt`, zero on the diagonal, `[..., N, N]`; None before
            learning begins.
        seen: share that the running mean of the power has seen of itself, for it starts at zero; None where it is
            not kept.
    """

    factor: Tensor | None
    seen: Tensor | None


def moments(clock: Tensor, like: Tensor, constants: Constants) -> Iterator[Moment]:
    """Moments at readings of the learning's clock, `[K, ...]`, for signals like `[..., N]`; one for each of K."""
    c, rule = constants, constants.rule
    assert rule is not None
    # Delayed: o(t + dt), which the rule sees at the time t.
    lag = 1 if c.feedback == "delayed" and not c.faint else 0
    seconds = (clock - lag) * c.dt - c.settle
    ready = [True] * len(clock) if torch.compiler.is_compiling() or clock.ndim > 1 else (seconds > 0).tolist()
    batch = like.ndim - (2 if c.shared else 1)
    rates = rule.rate(seconds if clock.ndim > 1 else seconds.reshape(-1, *[1] * batch))
    scale = (rates * (c.dt * c.every)).to(like.dtype)[..., None, None]
    apart = 1 - torch.eye(like.shape[-1], dtype=like.dtype, device=like.device)
    # Many networks with rates of their own: not all of their steps at once.
    factors = (scale * apart).unbind(0) if scale.numel() == len(clock) else (part * apart for part in scale.unbind(0))
    seen: list[Tensor | None] = [None] * len(clock)
    if rule.uses_power:
        keep = math.log1p(-c.mean_square.a) if c.mean_square.a < 1 else -math.inf
        seen = list((-torch.expm1(keep * clock)).to(like.dtype).unsqueeze(-1).unbind(0))
    for begun, factor, share in zip(ready, factors, seen, strict=True):
        yield Moment(factor if begun else None, share)


def network_step(
    block: Tensor, state: NetworkState, constants: Constants, moment: Moment | None
) -> tuple[Tensor, NetworkState, Tensor | None]:
    """One step of the network, from one change of the weights to the next.

    Args:
        block: drive i', `[..., N]` for delayed feedback, a block `[..., E, N]` for settled; `[..., F, N]` and
            `[..., E, F, N]` of fields.
        state: before.
        constants: of the network.
        moment: None where the clock is in the state.

    Returns:
        outputs like `block`, the state after, and the summed magnitude of the change of the mean weights, `[...]`, None
        if there was no change.
    """
    c, rule, weights = constants, constants.rule, state.weights
    outputs, fluctuation, clock = state.outputs, state.fluctuation, state.clock
    if c.feedback == "delayed":
        out = outputs = block - outputs @ weights.mT if c.shared else inhibit(block, weights, outputs)
    else:
        out = through(block, weights, c.shared)
    if rule is None:
        return out, state._replace(outputs=outputs), None
    high, low = fluctuations(out, state.output_low, c)
    compiled, awake, squares = torch.compiler.is_compiling(), None, None
    if c.faint:
        squares = high.square()
        awake = squares.mean(-1).flatten(clock.ndim).amax(-1) >= c.faint**2
        if not compiled and not awake.any():
            return out, state._replace(outputs=outputs, output_low=low), torch.zeros_like(clock, dtype=out.dtype)
        clock = clock + awake * c.every
        if moment is None:
            moment = next(moments(clock.unsqueeze(0), out.select(-3 if c.shared else -2, 0), c))
    assert moment is not None
    # Alone, it is awake here.
    awake = awake if compiled or clock.ndim else None
    if rule.uses_power:
        squares = high.square() if squares is None else squares
        kept, taken = c.mean_square.weights(high.select(-2, 0) if c.shared else high)
        fluctuation = held(awake, kept * fluctuation + taken @ (squares.sum(-2) if c.shared else squares), fluctuation)
    mean, stopped, shift = state.mean_weights, state.stopped, None
    if moment.factor is not None:
        power = fluctuation if moment.seen is None else fluctuation / moment.seen
        change = rule.change(high.flatten(-3, -2) if c.shared else high, power, weights, c.every)
        grown, full = rule.bounded(torch.addcmul(weights, change, moment.factor))
        learning = awake
        if compiled:
            begun = moment.factor.amax((-1, -2)) > 0
            learning = begun if awake is None else awake & begun
        if c.when_full == "stop":
            learning = ~stopped if learning is None else learning & ~stopped
            stopped = stopped if full is None else stopped | (full if awake is None else full & awake)
        weights = held(learning, grown, weights)
        step = (weights.detach() - mean) * c.a_mean
        step = held(awake, step, torch.zeros_like(step))
        mean, shift = mean + step, torch.linalg.vector_norm(step, 1, (-1, -2))
    # By position: `_replace` costs as much as three operations.
    end = NetworkState(
        weights, outputs, state.input_low, low, state.recent, fluctuation, clock, stopped, mean, *state[9:]
    )
    return out, end, shift


def fluctuations(out: Tensor, low: Tensor, constants: Constants) -> tuple[Tensor, Tensor]:
    """High-passed outputs o' of one step, `[..., E, N]` or `[..., E, F, N]`, and the filter's state."""
    c, time = constants, -3 if constants.shared else -2
    if c.feedback == "delayed":
        low = low_pass_step(out, low, c.output_low.a)
        return (out - low).unsqueeze(time), low
    if c.every == 1:
        lows = low_pass_step(out, low.unsqueeze(time), c.output_low.a)
    else:
        lows = c.output_low(out.flatten(-2), low.flatten(-2)).view_as(out) if c.shared else c.output_low(out, low)
    return out - lows, lows.select(time, -1)


def held(where: Tensor | None, new: Tensor, old: Tensor) -> Tensor:
    """`new` for the networks `where` `[...]`, `old` for the others; None: all."""
    if where is None:
        return new
    return torch.where(where.reshape(where.shape + (1,) * (new.ndim - where.ndim)), new, old)


def latest_changes(changes: Tensor, shifts: list[tuple[Tensor, Tensor | None]]) -> Tensor:
    """The latest changes `[..., S]`, as many as before, after new ones `[...]`: those that are known, or turn out, to
    come from whole blocks."""
    if all(known is None for _, known in shifts):
        return torch.cat([changes, *(shift.unsqueeze(-1) for shift, _ in shifts)], -1)[..., -changes.shape[-1] :]
    for shift, known in shifts:
        later = torch.cat([changes[..., 1:], shift.unsqueeze(-1)], -1)
        changes = later if known is None else torch.where(known, later, changes)
    return changes


def weight_change(state: NetworkState) -> Tensor:
    """Summed magnitude of the changes of all mean weights over the recent window, `[...]`. [C eq. 5]

    As printed, the sum is over the weights themselves; but weights ripple with the fluctuations they are learned
    from, the more the faster they learn, and it is their temporal mean that settles [B §3.4.1]. `tau_mean=0`
    gives the printed sum.
    """
    return state.changes.sum(-1)


def alternation(state: NetworkState) -> Tensor:
    """How much of the outputs' recent power flips sign from sample to sample, `[...]`, 0 to 1.

    For a pure alternation the squared difference of successive outputs is four times their power; for signals
    that are slow against the time step it is near zero, and with settled feedback it is zero.
    """
    power, roughness = state.power, state.roughness
    over = tuple(range(state.stopped.ndim, power.ndim))
    return roughness.sum(over) / (4 * power.sum(over)).clamp_min(torch.finfo(power.dtype).tiny)
