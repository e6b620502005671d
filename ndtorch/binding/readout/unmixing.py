"""Sources in covariances of the sums: their number, and the mixing that makes all delays diagonal."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.binding.readout.delays import diagonalise
from ndtorch.binding.readout.directions import LINEAR, crowded, empty, full, stands_out, unexplained
from ndtorch.binding.readout.even_light import even_light, without
from ndtorch.binding.readout.params import SourceCriteria, SumCriteria

MOST = 5
"""Sources that leave one of six directions to noise."""


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
    five = full(flat[:, 0, LINEAR, LINEAR], flat[:, 1, LINEAR, LINEAR], limits)
    four, exact = empty(flat[:, 0, LINEAR, LINEAR], flat[:, 1, LINEAR, LINEAR], limits)
    linear = torch.where(four, linear.clamp_min(MOST - 1), linear)
    linear = torch.where(five, linear.clamp_min(MOST), linear)
    every = stands_out(flat[:, 0], flat[:, 1], limits.crowded, limits)
    light = even_light(flat[:, 1], linear, limits)
    lit = light.abs().amax(-1) > 0
    wide = crowded(flat[:, 0, LINEAR, LINEAR], flat[:, 1, LINEAR, LINEAR], limits) & (linear > 0) & ~lit
    count = torch.where(wide & ~exact, torch.maximum(linear, every), linear)
    more = unexplained(flat[:, 0], flat[:, 1], count, limits) & ~lit
    wide, count = wide | more, (count + more.long()).clamp_max(most)
    found = unmixed(flat, count, wide, light, criteria)
    # Beside two of one rate, what is faint is an overtone of theirs: a shadow's edge does not dim all sums alike.
    values = torch.linalg.eigvalsh(flat[:, 1, LINEAR, LINEAR])
    fewer = (values > limits.doubtful * values[:, -1:]).sum(-1)
    again = (found.gap < criteria.gap) & ~wide & ~lit & (fewer < count) & (fewer > 1) & ~(exact & (fewer > 2))
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


def choose(where: Tensor, yes: Tensor, no: Tensor) -> Tensor:
    """`torch.where` for tensors of more dimensions than the condition."""
    return torch.where(where.reshape(where.shape + (1,) * (yes.ndim - where.ndim)), yes, no)
