"""Read-out by delays: the mixing that diagonalises the covariances of signals with their own past, and what owns it.

Signals `y = A s` of sources that do not go together have covariances `C(d) = A R(d) A^T` at every delay d, with R(d)
diagonal: one A makes all of them diagonal, unless two sources have the same correlation with their own past
(Belouchrani et al. 1997). White noise is in C(0) alone, which is left out.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.binding.feedback import settled
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.owners import features_by_group
from ndtorch.binding.readout.params import SourceCriteria
from ndtorch.vision.features import GROUPS

DELAYS = (0.01, 0.05, 0.1, 0.2, 0.4, 0.8)
"""Seconds; each becomes a whole number of time steps, at least one."""


def without_lighting(separation: Separation, first_stage: Tensor, criteria: SourceCriteria) -> Separation:
    """The same without `lighting`."""
    mixing = separation.mixing
    there = torch.arange(mixing.shape[-2], device=mixing.device) < separation.sources.unsqueeze(-1)
    even = lighting(mixing, there, first_stage, criteria)
    # What is left moves to the front.
    order = torch.argsort((even | ~there).long(), dim=-1, stable=True)
    mixing = mixing.gather(-2, order.unsqueeze(-1).expand_as(mixing))
    sources = (there & ~even).sum(-1)
    rank = torch.arange(mixing.shape[-2], device=mixing.device)
    mixing = torch.where((rank < sources.unsqueeze(-1)).unsqueeze(-1), mixing, 0.0)
    return separation._replace(mixing=mixing, sources=sources)


def lighting(mixing: Tensor, there: Tensor, first_stage: Tensor, criteria: SourceCriteria) -> Tensor:
    """Sources that drive all colors and all orientations alike, or none, and hardly move or move every way alike.

    Args:
        mixing: `[..., S, 10]`, one row a source, through the settled first stage.
        there: which rows are sources, `[..., S]` bool.
        first_stage: weights of the first stage, `[10, 10]`.
        criteria: what is even.

    Returns:
        Which of them are light that changes everywhere, `[..., S]` bool.
    """
    eye = torch.eye(10, dtype=mixing.dtype, device=mixing.device)
    raw = mixing @ (eye + first_stage.to(mixing.dtype)).mT
    even = there
    for group in (raw[..., GROUPS["orientation"]], raw[..., GROUPS["color"]]):
        nothing = group.amax(-1) < criteria.absent * raw.amax(-1)
        even = even & (nothing | (group.amin(-1) >= criteria.even * group.amax(-1)))
    directed = mixing[..., GROUPS["motion"]]
    motion = torch.where(there, directed.amax(-1).clamp_min(0), 0.0)
    # Alone, it has the largest motion there is: what flickers moves every way alike, or its motion is noise.
    everywhere = (directed.amin(-1) >= criteria.even * motion) | (motion < criteria.absent * raw.amax(-1))
    return even & (everywhere | (motion < criteria.moving * motion.amax(-1, keepdim=True)))


def plain_table(
    owners: ObjectTable, weights: Tensor, first_stage: Tensor, criteria: SourceCriteria | None = None
) -> ObjectTable:
    """The owners' table without lighting, and without any owner where there are more than `most_sources`.

    Where almost every signal goes its own way it is noise, and there is nothing to bind.

    Args:
        owners: the owners' table.
        weights: of the network, `[..., 10, 10]`.
        first_stage: weights of the first stage, `[10, 10]`.
        criteria: see there.
    """
    c = criteria or SourceCriteria()
    mixing = weights.mT + torch.eye(10, dtype=weights.dtype, device=weights.device)
    light = lighting(mixing, owners.owners, first_stage, c)
    noise = owners.owners.sum(-1, keepdim=True) > c.most_sources
    kept = owners.owners & ~light & ~noise
    return ObjectTable(kept, torch.where(kept.unsqueeze(-1), owners.rows, 0.0))


def assigned(mixing: Tensor, count: Tensor, weights: Tensor, smallest: float = 1 / 3) -> ObjectTable:
    """Give every source the neuron whose output is most purely that source, among the features it has.

    Shapes: mixing `[..., S, N]`, count `[...]`, weights T `[..., N, N]`.
    """
    rows = features_by_group(mixing, smallest)
    gain = (mixing @ settled(weights).mT).square()
    total = gain.sum(-2, keepdim=True).clamp_min(torch.finfo(gain.dtype).tiny)
    purity = torch.where(rows > 0, gain * gain / total, -1.0)
    owners = torch.zeros(*count.shape, mixing.shape[-1], dtype=torch.bool, device=mixing.device)
    out = torch.zeros_like(weights)
    for source in range(mixing.shape[-2]):
        score = purity[..., source, :].masked_fill(owners, -torch.inf)
        here = torch.nn.functional.one_hot(score.argmax(-1), mixing.shape[-1]).bool()
        here = here & (source < count).unsqueeze(-1)
        owners = owners | here
        out = torch.where(here.unsqueeze(-1), rows[..., source, :].unsqueeze(-2), out)
    return ObjectTable(owners, out)


class Separation(NamedTuple):
    """Sources and their mixing; S is the largest number of sources asked for.

    Attributes:
        sources: how many there are, `[...]`, int64.
        mixing: `[..., S, N]`, one row a source, the largest entry positive; zeros beyond `sources`.
        gap: smallest difference between the delay profiles of two sources, `[...]`: the sum over delays of the squared
            difference of their correlations with their own past. Near zero, those two are not identified. Infinite
            with fewer than two.
    """

    sources: Tensor
    mixing: Tensor
    gap: Tensor


def diagonalise(matrices: Tensor, sweeps: int = 12, enough: float = 1e-6) -> tuple[Tensor, Tensor]:
    """The rotation that makes symmetric matrices `[B, L, m, m]` as diagonal as they get together, and the results.

    Jacobi rotations of every pair in turn, each at the angle of Cardoso and Souloumiac (1996).

    Returns:
        V `[B, m, m]`, orthogonal, and `V^T M V`.
    """
    m = matrices.shape[-1]
    out = matrices.clone()
    rotation = torch.eye(m, dtype=out.dtype, device=out.device).repeat(len(out), 1, 1)
    for _ in range(sweeps):
        largest = 0.0
        for p in range(m):
            for q in range(p + 1, m):
                difference = out[..., p, p] - out[..., q, q]
                between = 2 * out[..., p, q]
                on = (difference.square() - between.square()).sum(-1)
                off = 2 * (difference * between).sum(-1)
                angle = 0.5 * torch.atan2(off, on + torch.hypot(on, off))
                largest = max(largest, float(angle.abs().max()))
                turn = torch.stack([angle.cos(), -angle.sin(), angle.sin(), angle.cos()], -1).reshape(-1, 2, 2)
                pair = [p, q]
                out[..., pair] = out[..., pair] @ turn.unsqueeze(1)
                out[..., pair, :] = turn.mT.unsqueeze(1) @ out[..., pair, :]
                rotation[..., pair] = rotation[..., pair] @ turn
        if largest < enough:
            break
    return rotation, out
