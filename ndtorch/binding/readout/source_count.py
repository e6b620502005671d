"""How many sources the sums hold, and the times at which no source covers another."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.covariance import CovarianceState
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.readout.owners import SumCriteria
from ndtorch.vision.features import GROUPS

LINEAR = slice(GROUPS["motion"].stop, None)
"""Signals that are proportional to brightness: orientations and colors."""
WAYS = 4
"""Signals of motion: so many sources move every way there is."""
NOTHING = 1e-6
"""Share of the largest that single precision leaves in a direction without anything."""
KNOWN = 0.05
"""Share of the largest under which a direction of motion is none."""
WEAKEST = 3
"""Directions that are taken for noise."""


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


def full(without: Tensor, delayed: Tensor, limits: SumCriteria) -> Tensor:
    """Whether sources leave but one direction of orientations and colors to noise, which has next to none, `[B]`.

    A single direction says little about noise, so this is asked only where it and what is there at once hold less than
    `quiet`.
    """
    values = torch.linalg.eigvalsh(delayed)
    top, weakest = values[:, -1], torch.maximum(values[:, 0].abs(), torch.linalg.eigvalsh(without)[:, 0])
    least = torch.maximum(limits.least_alone * top, limits.alone * weakest)
    held: Tensor = (values[:, 1] > least) & (weakest < limits.quiet * top)
    return held


def empty(without: Tensor, delayed: Tensor, limits: SumCriteria) -> tuple[Tensor, Tensor]:
    """Whether two directions hold next to nothing beside a fourth source, and whether they hold nothing, `[B]` each.

    Two such directions say that there is hardly any noise, so that the fourth source may be fainter than `faintest`.
    Where they hold nothing at all, orientations and colors are an exact mixture and show every source.
    """
    values = torch.linalg.eigvalsh(delayed)
    top, weakest = values[:, -1], torch.maximum(values[:, 1].abs(), torch.linalg.eigvalsh(without)[:, 1])
    four = values[:, 2] > torch.maximum(limits.least_alone * top, limits.alone * weakest)
    return four, four & (weakest < NOTHING * top)


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
        # Motion of a known source has a time course of its own: that is no other source. Another moves another way.
        other = torch.eye(WAYS, dtype=along.dtype).expand(len(at), WAYS, WAYS)
        if m < WAYS:
            other = other - along @ torch.linalg.pinv(along, rtol=KNOWN)
        left, at_once = (
            torch.linalg.eigvalsh(other @ (part[:, motion, motion] - along @ along.mT) @ other.mT)[:, -1]
            for part in (here, plain[at])
        )
        largest = torch.linalg.eigvalsh(here[:, motion, motion])[:, -1]
        noise = torch.maximum(values[:, 0].abs(), torch.linalg.eigvalsh(plain[at][:, LINEAR, LINEAR])[:, 0])
        clean = noise < limits.quiet * values[:, -1]
        # White noise is gone after the delay.
        found[at] = clean & (left > (limits.elsewhere if m < WAYS else limits.moved) * largest) & (left > 0.5 * at_once)
    return found


ROUNDS = 6
"""What is left out changes what orientations hold beside colors: so often at most."""
RIDGE = 1e-4
"""Share of the colors' power that is added to each of them where orientations are explained by them."""


def undisturbed(statistics: CovarianceState, tau: float, piece: float, limits: SumCriteria) -> Tensor:
    """Covariances of the stretches of time without disturbance, the latest with the most weight.

    Args:
        statistics: with pieces `[..., P, L, 10, 10]`, the second delay the shortest.
        tau: the memory, seconds.
        piece: length of a piece, seconds.
        limits: of what is left out.

    Returns:
        `[..., L, 10, 10]`, as strong as a memory of all of them.
    """
    held, age = statistics.held, statistics.age.unsqueeze(-1)
    pieces = statistics.pieces / held.clamp_min(1)[:, None, None, None]
    count, there = len(held), held > 0
    since = piece * torch.arange(count - 1, -1, -1, dtype=pieces.dtype, device=pieces.device)
    weight = held * torch.exp(-since / tau)
    total = (weight[:, None, None, None] * pieces).sum(-4) / weight.sum().clamp_min(1)
    scale = spread_groups(group_max(total[..., 0, :, :].diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()))
    delayed = divide(pieces[..., 1, :, :], (scale.unsqueeze(-1) * scale.unsqueeze(-2)).unsqueeze(-3)).double()
    keep = there.expand(delayed.shape[:-2])
    for _ in range(ROUNDS):
        left = beside_colors(delayed, keep * weight, there, limits)
        if bool((left == keep).all()):
            break
        keep = left
    chosen = keep * weight
    share = chosen * (1 - torch.exp(-age / tau)) / chosen.sum(-1, keepdim=True).clamp_min(1e-12)
    found: Tensor = (share[..., None, None, None] * pieces).sum(-4)
    return found


def beside_colors(delayed: Tensor, weight: Tensor, there: Tensor, limits: SumCriteria) -> Tensor:
    """Which pieces hold no more beside the colors than most do, `[..., P]` bool.

    Args:
        delayed: covariances at the shortest delay, of motion, orientations and colors, `[..., P, 10, 10]`.
        weight: of those that are kept, `[..., P]`.
        there: which hold anything, `[..., P]` bool.
        limits: see there.
    """
    orientation, color = GROUPS["orientation"], GROUPS["color"]
    whole = (weight[..., None, None] * delayed).sum(-3) / weight.sum(-1).clamp_min(1e-12)[..., None, None]
    colors = whole[..., color, color]
    power = colors.diagonal(dim1=-2, dim2=-1).sum(-1).clamp_min(1e-12)
    ridge = RIDGE * power[..., None, None] * torch.eye(3, dtype=colors.dtype, device=colors.device)
    explained = torch.linalg.solve(colors + ridge, whole[..., color, orientation]).mT.unsqueeze(-3)
    rest = (
        delayed[..., orientation, orientation]
        - 2 * explained @ delayed[..., color, orientation]
        + explained @ delayed[..., color, color] @ explained.mT
    )
    left = rest.diagonal(dim1=-2, dim2=-1).sum(-1)
    middle = torch.where(there, left, torch.nan).nanmedian(-1, keepdim=True).values
    largest = whole[..., orientation, orientation].diagonal(dim1=-2, dim2=-1).sum(-1, keepdim=True)
    kept: Tensor = there & (left <= torch.maximum(limits.covered * middle, limits.beside * largest))
    return kept
