"""How many directions of the sums stand out of the noise: the number of sources.

Noise has a power in every direction: what the weakest directions hold is noise, and so is what the covariance without
delay holds more than the one with the shortest delay.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.readout.params import SumCriteria
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
