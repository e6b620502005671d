"""The two forms of the network's feedback: with a delay of one time step, and settled."""

from __future__ import annotations

from typing import Literal

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
