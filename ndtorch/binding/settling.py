"""Whether a network has come to rest: how its weights change, and how much its outputs alternate."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.learning import NetworkState


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
