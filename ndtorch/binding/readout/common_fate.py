"""Read-out of what moves together: patches, with their outline, from maps of motion in every direction."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ndtorch.config import Constants, constant
from ndtorch.errors import InputError
from ndtorch.vision.coherent import CoherentMotion, CoherentState, moved_on, windows

LEAST = 0.4
"""Contrast in a window, against that of the frame, under which a share of it would be of a dot or two."""

UPS = 0.25
"""Share of the ground's motion by which its places differ."""


class FateCriteria(Constants):
    """When motion is common, and where it ends."""

    clear: float = constant(5.5, "peak of a map of motion over the deviation of all maps", gt=0)
    beside: float = constant(0.35, "share of the clearest peak that a further motion has at least", ge=0, le=1)
    least: float = constant(0.08, "share of the contrast in a wide window that moves so, above others,", gt=0)
    wide: float = constant(8.0, "deviation of that window, pixels", gt=0)
    most: int = constant(6, "velocities that are looked for at most", gt=0)
    spread: float = constant(4.0, "deviation of the window in which it ends, pixels; wider where little moves so", gt=0)
    edge: float = constant(0.5, "share of its level at which a patch ends", gt=0, lt=1)
    piece: float = constant(0.7, "share of its level that every piece of a patch reaches", ge=0, lt=1)
    smallest: float = constant(0.006, "smallest patch, as a share of the frame", gt=0)
    alike: float = constant(15.0, "velocities nearer than this are one, pixels a second", gt=0)
    echo: float = constant(0.7, "share of a clearer motion that other velocities have at its place", gt=0, lt=1)
    refine: float = constant(4.0, "step with which a velocity is looked at closer, pixels a second", gt=0)


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


def standing_out(maps: Tensor, seen: Tensor, inside: Tensor) -> tuple[Tensor, Tensor]:
    """Maps `[D, R, C]` less what most fields have, and the deviation of what is left.

    The ground is what most fields have: a ring of all directions, a peak where it moves as a whole. What came into the
    frame lately has less of it. Few dots make a few high values, so the deviation is that of the upper tail.

    Args:
        maps: of `CoherentMotion`.
        seen: how much of each field was in the frame at each velocity, like `maps`.
        inside: how much of each field is in the frame, `[R, C]`: of a smaller one less is known.
    """
    seen = seen / inside
    ground = (maps / seen).masked_fill(seen < 0.5, torch.nan).flatten(1).nanmedian(1).values.nan_to_num(0)
    left = (maps - ground[:, None, None] * seen) * inside.sqrt()
    tail = left.flatten().kthvalue(math.ceil(0.95 * left.numel())).values / 1.645
    # Where the ground is strong, its own ups and downs are too.
    return left - UPS * ground.clamp_min(0)[:, None, None], tail


def aligned(past: Tensor, velocity: Tensor, apart: float, since: float = 0.0) -> Tensor:
    """Frames `[B, H, W]`, `apart` seconds from each other and the latest `since` seconds ago, each moved on to where it
    would be now at that velocity, columns and rows a second.
    """
    count, height, width = past.shape
    age = since + apart * torch.arange(count - 1, -1, -1, dtype=past.dtype, device=past.device)
    shift = age[:, None] * velocity.to(past.dtype)
    x = torch.arange(width, dtype=past.dtype, device=past.device) - shift[:, :1]
    y = torch.arange(height, dtype=past.dtype, device=past.device) - shift[:, 1:]
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
    line = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, dtype=image.dtype, device=image.device) / deviation) ** 2)
    line = line / line.sum()
    flat = functional.conv2d(image[None, None], line[None, None, None, :], padding=(0, reach))
    return functional.conv2d(flat, line[None, None, :, None], padding=(reach, 0))[0, 0]


def ratio(together: Tensor, power: Tensor, spread: float) -> Tensor:
    """The share that moves so in a window around every pixel; little where there is little contrast."""
    power = blurred(power, spread)
    least = LEAST * power.mean()
    return blurred(together, spread) / torch.maximum(power, least).clamp_min(torch.finfo(power.dtype).tiny)


def coherent_patches(motion: CoherentMotion, state: CoherentState, criteria: FateCriteria | None = None) -> list[Patch]:
    """What moves together at this moment, of one trial, clearest first.

    A peak in the maps names a velocity. Space-time energy at that velocity, at full resolution, tells where it ends:
    where it falls below `edge` of its level. Every pixel belongs to the velocity that explains most of it.
    """
    c = criteria or FateCriteria()
    if state.past.ndim != 3:
        raise InputError(f"state must be of one trial, got {list(state.past.shape[:-3])} of them")
    velocities = motion.velocities.to(state.past.dtype)
    left, deviation = standing_out(motion.maps(state), motion.seen, motion.inside)
    found: list[Layer] = []
    enough = max(c.clear * float(deviation), c.beside * float(left.amax()))
    for _ in range(c.most):
        which, row, column = (int(part) for part in torch.unravel_index(left.argmax(), left.shape))
        if float(left[which, row, column]) <= enough or not float(deviation) > 0:
            break
        velocity = centered(left[:, row, column], which, velocities, 1.5 * motion.params.step)
        velocity = refined(motion, state, velocity, (row, column), c.refine)
        layer = layer_of(motion, state, velocity, c)
        if float(layer.wide.amax()) > c.least:
            found.append(layer)
        left = left - c.echo * left[which].clamp_min(0)
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


def layer_of(motion: CoherentMotion, state: CoherentState, velocity: Tensor, criteria: FateCriteria) -> Layer:
    """A closer look at a velocity; where little moves so, the window is wider."""
    moved = aligned(state.past, velocity, motion.apart, motion.since(state))
    together, power = motion.energy(moved), moved.square().mean(0)
    wide = ratio(together, power, criteria.wide)
    wide = wide - wide.median()
    level = float(wide.amax())
    spread = criteria.spread * min(max(level, 0.25), 1.0) ** -0.5
    share = ratio(together, power, spread)
    share = share - share.median()
    return Layer(velocity, share / max(level, 1e-6), wide)


def centered(line: Tensor, which: int, velocities: Tensor, near: float) -> Tensor:
    """The velocity of a peak of `line` `[D]`, between those of the grid `[D, 2]` too."""
    around: Tensor = (velocities - velocities[which]).norm(dim=-1) < near
    weights = ((line - 0.5 * line[which]).clamp_min(0) * around)[:, None]
    center: Tensor = (weights * velocities).sum(0) / weights.sum()
    return center


def refined(
    motion: CoherentMotion, state: CoherentState, velocity: Tensor, field: tuple[int, int], step: float
) -> Tensor:
    """A velocity, corrected by the energy in one field at full resolution a `step` to all sides of it."""
    rows, columns = (
        windows(side, side, len(all), motion.params.window)[n].to(state.past.dtype)
        for side, all, n in zip(motion.size, (motion.rows, motion.columns), field, strict=True)
    )

    def energy(at: Tensor) -> float:
        moved = moved_on(state.past, (motion.apart * at).tolist())
        return float(rows @ motion.energy(moved) @ columns)

    middle, better = energy(velocity), velocity.clone()
    for axis in (0, 1):
        off = torch.zeros_like(velocity)
        off[axis] = step
        less, more = energy(velocity - off), energy(velocity + off)
        bend = less - 2 * middle + more
        away = (less - more) / (2 * bend) if bend < 0 else float(more > less) - float(less > more)
        better[axis] += step * min(max(away, -1.0), 1.0)
    return better


def pieces(mask: Tensor, layer: Layer, criteria: FateCriteria) -> list[Patch]:
    """The connected parts of a mask `[H, W]` that are large and clear enough, without their holes."""
    outlines, _ = cv2.findContours(mask.numpy().astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    found = []
    for outline in outlines:
        filled = np.zeros(tuple(mask.shape), np.uint8)
        cv2.drawContours(filled, [outline], -1, 1, -1)
        part = torch.from_numpy(filled).bool()
        large = int(part.sum()) >= criteria.smallest * mask.numel()
        if large and float(layer.wide[part].amax()) > max(criteria.least, criteria.piece * float(layer.wide.amax())):
            rows, columns = part.nonzero().double().mean(0).tolist()
            across, down = layer.velocity.tolist()
            found.append(Patch(part, (columns, rows), (across, down), float(layer.wide[part].mean())))
    return found
