"""Read-out of what moves together: patches, with their outline, from maps of motion in every direction."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
import torch
from pydantic import Field
from torch import Tensor
from torch.nn import functional

from ndtorch.config import Constants
from ndtorch.errors import InputError
from ndtorch.vision.coherent import CoherentMotion, CoherentState

LEAST = 0.4
"""Contrast in a window, against that of the frame, under which a share of it would be of a dot or two."""


class FateCriteria(Constants):
    """When motion is common, and where it ends."""

    clear: float = Field(4.0, gt=0, description="peak of a map of motion over the deviation of all maps")
    least: float = Field(0.15, gt=0, description="share of the contrast in a wide window that moves so, above others,")
    wide: float = Field(8.0, gt=0, description="deviation of that window, pixels")
    most: int = Field(6, gt=0, description="velocities that are looked for at most")
    spread: float = Field(
        4.0, gt=0, description="deviation of the window in which it ends, pixels; wider where little moves so"
    )
    first: float = Field(0.08, gt=0, description="shortest and")
    last: float = Field(0.32, gt=0, description="longest delay at which it compares frames, seconds")
    edge: float = Field(0.5, gt=0, lt=1, description="share of its level at which a patch ends")
    smallest: float = Field(0.006, gt=0, description="smallest patch, as a share of the frame")
    alike: float = Field(15.0, gt=0, description="velocities nearer than this are one, pixels a second")


class Patch(NamedTuple):
    """What moves together.

    Attributes:
        mask: its pixels, `[H, W]` bool.
        place: column and row of its center.
        velocity: columns and rows a second.
        strength: share of its contrast that moves so.
    """

    mask: Tensor
    place: tuple[float, float]
    velocity: tuple[float, float]
    strength: float


def standing_out(maps: Tensor) -> tuple[Tensor, Tensor]:
    """Maps `[D, R, C]` less what most fields have, and the deviation of what is left.

    The ground is what most fields have: a ring of all directions, a peak where it moves as a whole.
    """
    left = maps - maps.flatten(1).median(1).values[:, None, None]
    return left, 1.4826 * left.abs().median()


def aligned(past: Tensor, velocity: Tensor, dt: float) -> Tensor:
    """Frames `[B, H, W]`, the latest last, each moved on to where it would be now at that velocity."""
    count, height, width = past.shape
    age = dt * torch.arange(count - 1, -1, -1, dtype=past.dtype)
    shift = age[:, None] * velocity.to(past.dtype)
    x = torch.arange(width, dtype=past.dtype) - shift[:, :1]
    y = torch.arange(height, dtype=past.dtype) - shift[:, 1:]
    grid = torch.stack(
        [
            (2 * x / (width - 1) - 1)[:, None, :].expand(count, height, width),
            (2 * y / (height - 1) - 1)[:, :, None].expand(count, height, width),
        ],
        -1,
    )
    return functional.grid_sample(past.unsqueeze(1), grid, align_corners=True).squeeze(1)


def blurred(image: Tensor, deviation: float) -> Tensor:
    """An image `[H, W]` through a Gaussian window."""
    reach = max(1, round(2.5 * deviation))
    line = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, dtype=image.dtype) / deviation) ** 2)
    line = line / line.sum()
    flat = functional.conv2d(image[None, None], line[None, None, None, :], padding=(0, reach))
    return functional.conv2d(flat, line[None, None, :, None], padding=(reach, 0))[0, 0]


def energies(past: Tensor, velocity: Tensor, dt: float, criteria: FateCriteria) -> tuple[Tensor, Tensor]:
    """What moves at a velocity, and all contrast, at every pixel `[H, W]`: energy oriented in space and time."""
    moved = aligned(past, velocity, dt)
    first, last = max(1, round(criteria.first / dt)), max(1, round(criteria.last / dt))
    last = min(max(first, last), len(moved) - 1)
    together = torch.zeros_like(moved[0])
    for lag in range(first, last + 1):
        together += (moved[lag:] * moved[:-lag]).mean(0)
    return together / (last - first + 1), moved.square().mean(0)


def ratio(together: Tensor, power: Tensor, spread: float) -> Tensor:
    """The share that moves so in a window around every pixel; little where there is little contrast."""
    power = blurred(power, spread)
    least = LEAST * power.mean()
    return blurred(together, spread) / torch.maximum(power, least).clamp_min(torch.finfo(power.dtype).tiny)


def coherent_patches(motion: CoherentMotion, state: CoherentState, criteria: FateCriteria | None = None) -> list[Patch]:
    """What moves together at this moment, of one trial, clearest first.

    A peak in the maps names a velocity. Space-time energy at that velocity, over all frames that are kept, tells where
    it ends: where it falls below `edge` of its level. Every pixel belongs to the velocity that explains most of it.

    Args:
        motion: the detectors.
        state: theirs.
        criteria: see there.

    Raises:
        InputError: a state of several trials.
    """
    c = criteria or FateCriteria()
    if state.power.ndim != 2:
        raise InputError(f"state must be of one trial, got {list(state.power.shape[:-2])} of them")
    maps, velocities = motion.maps(state), motion.velocities.to(state.power.dtype)
    left, deviation = standing_out(maps)
    found: list[Layer] = []
    for _ in range(c.most):
        peak = int(left.argmax())
        which, row, column = (int(part) for part in torch.unravel_index(torch.tensor(peak), left.shape))
        if float(left[which, row, column]) < c.clear * float(deviation):
            break
        velocity = centered(left[:, row, column], which, motion.reach) / (motion.lag * motion.dt)
        layer = layer_of(state.past, velocity, motion.dt, c)
        if float(layer.wide.amax()) > c.least:
            found.append(layer)
        left = left.clone()
        left[(velocities - velocity).norm(dim=-1) < c.alike] = -torch.inf
    if not found:
        return []
    most, owner = torch.stack([layer.share for layer in found]).max(0)
    patches: list[Patch] = []
    for n, layer in enumerate(found):
        patches += pieces((owner == n) & (most > c.edge), layer, c)
    return sorted(patches, key=lambda patch: -patch.strength * float(patch.mask.sum()))


class Layer(NamedTuple):
    """What moves at one velocity: share of the contrast around every pixel over its level, and in a wide window."""

    velocity: Tensor
    share: Tensor
    wide: Tensor


def layer_of(past: Tensor, velocity: Tensor, dt: float, criteria: FateCriteria) -> Layer:
    """A closer look at a velocity; where little moves so, the window is wider."""
    together, power = energies(past, velocity, dt, criteria)
    wide = ratio(together, power, criteria.wide)
    wide = wide - wide.median()
    level = float(wide.amax())
    spread = criteria.spread * min(max(level, 0.25), 1.0) ** -0.5
    share = ratio(together, power, spread)
    share = share - share.median()
    return Layer(velocity, share / max(level, 1e-6), wide)


def centered(line: Tensor, which: int, reach: int) -> Tensor:
    """Column and row displacement of a peak of `line` `[D]`, between pixels too."""
    side = 2 * reach + 1
    image = line.reshape(side, side).clamp_min(0)
    row, column = divmod(which, side)
    rows = torch.arange(max(0, row - 1), min(side, row + 2))
    columns = torch.arange(max(0, column - 1), min(side, column + 2))
    part = image[rows][:, columns]
    part = part - 0.5 * part.amax()
    part = part.clamp_min(0)
    total = part.sum()
    if not float(total) > 0:
        return torch.tensor([column - reach, row - reach], dtype=line.dtype)
    x = (part.sum(0) * (columns - reach)).sum() / total
    y = (part.sum(1) * (rows - reach)).sum() / total
    return torch.stack([x, y])


def pieces(mask: Tensor, layer: Layer, criteria: FateCriteria) -> list[Patch]:
    """The connected parts of a mask `[H, W]` that are large and clear enough, without their holes."""
    outlines, _ = cv2.findContours(mask.numpy().astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    found = []
    for outline in outlines:
        filled = np.zeros(tuple(mask.shape), np.uint8)
        cv2.drawContours(filled, [outline], -1, 1, -1)
        part = torch.from_numpy(filled).bool()
        large = int(part.sum()) >= criteria.smallest * mask.numel()
        if large and float(layer.wide[part].amax()) > criteria.least:
            rows, columns = part.nonzero().double().mean(0).tolist()
            across, down = layer.velocity.tolist()
            found.append(Patch(part, (columns, rows), (across, down), float(layer.wide[part].mean())))
    return found
