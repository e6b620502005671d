"""State of an inhibitory network: feedback, what learning keeps, and whether it has converged."""

from __future__ import annotations

from typing import Literal, NamedTuple

import torch
from torch import Tensor

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
