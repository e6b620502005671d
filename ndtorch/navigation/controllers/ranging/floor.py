"""Where the floor ends: cells judged by whether they look like floor that moves past."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.navigation.controllers.ranging.floor_view import FloorParams, FloorView
from ndtorch.navigation.rig import StereoRig


class FloorState(NamedTuple):
    """State of `floor_step`, what was learned of the floor.

    Attributes:
        level: output of fast moving floor, `[..., bands]`; 0 while nothing is learned.
        noise: output while standing, `[...]`.
        age: time steps since the start, `[...]`.
    """

    level: Tensor
    noise: Tensor
    age: Tensor


class FloorSeen(NamedTuple):
    """What the cells show.

    Attributes:
        free: floor is seen here and in all nearer cells of the block, `[..., 2, bands, blocks]`, 0 or 1.
        ends: the nearest cell of its block that does not look like floor, 0 or 1.
        known: whether floor can be told at all now, `[..., bands]`, bool.
    """

    free: Tensor
    ends: Tensor
    known: Tensor


class FloorConstants(NamedTuple):
    """`FloorParams` for one time step; numbers that meet tensors are tensors, which is faster."""

    flow: Tensor
    yaw: Tensor
    saturation: Tensor
    least: Tensor
    tolerance: Tensor
    clear: Tensor
    standing: Tensor
    learning: Tensor
    learn_share: Tensor
    share: Tensor
    profile: Tensor
    moving: Tensor
    still: Tensor
    noise_share: Tensor
    upright: Tensor
    trusted: Tensor
    one: Tensor


def floor_constants(rig: StereoRig, params: FloorParams, view: FloorView, dt: float) -> FloorConstants:
    """Numbers of `floor_step`."""
    p = params
    # Far floor is finer than a pixel and gives less; before its own level is learned this is a fair guess.
    profile = (1.0 - 0.5 * (view.depth - 1.2)).clamp(min=0.3, max=1.0)
    standing = round(p.standing_time / dt)
    learning = standing + max(1, round(p.learning_time / dt))
    numbers = map(
        torch.tensor,
        (
            rig.focal * dt,
            -1 / p.saturation,
            1e-6,
            math.log(p.tolerance),
            p.clear * p.tolerance,
            float(standing),
            float(learning),
            2 / (learning - standing),
            dt / p.adaptation,
        ),
    )
    yaw, saturation, least, tolerance, clear, stands, learns, learn_share, share = numbers
    # A car that goes from forward to backward passes through 0 while its picture still moves: only a wheel that stands
    # says that what is seen is noise.
    rest = map(torch.tensor, (0.1, 0.001, 0.3, float(p.standing), p.trusted, 1.0))
    return FloorConstants(
        (view.sweep * dt).square(),
        yaw,
        saturation,
        least,
        tolerance,
        clear,
        stands,
        learns,
        learn_share,
        share / (2 * p.blocks),
        profile,
        *rest,
    )


def floor_step(
    cells: Tensor, speed: Tensor, curvature: Tensor, state: FloorState, constants: FloorConstants
) -> tuple[FloorSeen, FloorState]:
    """One time step: which cells look like floor, and learning how fast floor looks.

    Output grows with image speed v as `level (1 - exp(-v / saturation))`; the level follows the floor. A blank
    wall gives less, the foot of a wall and a textured wall more. So do lines, joints and checks; but there both eyes
    see one floor, and it goes on. What only one eye sees is believed to be an end of the floor as long as this eye is
    not mistaken elsewhere.

    What moves like floor may still be a thing that stands: a pole straight ahead hardly moves in the image, and while
    the car turns all that is in it moves alike. It hides all floor behind it, up to the horizon. So where both eyes
    see no one floor in some bands of a block, and in none behind them, the floor ends. What only one eye sees, as far
    out as that end or farther in the block beside it, is not called free: it most often shows the same thing. Both hold
    only where the eyes agree on enough floor elsewhere: those of a pair that was not measured well never do.

    Args:
        cells: outputs of `FloorMotion` at one time, `[..., 4, bands, blocks]`; without what both eyes see
            `[..., 2, bands, blocks]`.
        speed, curvature: what the car drove since the last frame, `[...]`.
    """
    c = constants
    cells, both = cells[..., :2, :, :], cells[..., 2:, :, :]
    speed = speed.abs()
    flow = (c.flow + (curvature * c.yaw).square().unsqueeze(-1)).sqrt() * speed.unsqueeze(-1)
    shape = -torch.expm1(flow * c.saturation)
    expected = state.level * shape
    age = state.age + c.one
    learning = (age <= c.learning).unsqueeze(-1)
    known = (expected > (state.noise * c.clear).unsqueeze(-1)) & ~learning
    excess = (cells.clamp(min=c.least) / expected.clamp(min=c.least).unsqueeze(-1).unsqueeze(-3)).log()
    sure = known.unsqueeze(-1).unsqueeze(-3)
    floor = (excess.abs() < c.tolerance) & sure
    goes_on, looks = floor, floor
    if both.shape[-3]:
        line = (both > 0) & sure & ~floor
        mistaken = line.any(-1, keepdim=True).any(-2, keepdim=True)
        trusted = agree(both, c.trusted)
        looks = (floor & ~(stands(both, c.upright) & trusted)) | line
        goes_on = looks | (mistaken & (both < 0))
    way = goes_on.to(cells.dtype).cumprod(-2)
    reached = torch.cat((torch.ones_like(way[..., :1, :]), way[..., :-1, :]), -2)
    free, ends = way * looks, (reached - way) * sure
    if both.shape[-3]:
        free = free * ~((both < 0) & beside_an_end(ends) & trusted)

    # What looks like floor teaches what floor looks like; at the start most of the nearest cells are floor.
    level = state.level * torch.exp((free * excess * floor).sum((-3, -1)) * c.share)
    near = max(1, cells.shape[-2] * 2 // 5)
    steady = cells / shape.clamp(min=c.moving).unsqueeze(-1).unsqueeze(-3)
    median = steady[..., :near, :].flatten(-3).median(-1).values.unsqueeze(-1) * c.profile
    first = torch.where(state.level > 0, torch.lerp(state.level, median, c.learn_share.to(median.dtype)), median)
    moving = ((age > c.standing) & (speed > c.moving)).unsqueeze(-1)
    level = torch.where(learning, torch.where(moving, first, state.level), level)
    median_now = cells.flatten(-3).median(-1).values
    noise = torch.where(
        speed < c.still, torch.lerp(state.noise, median_now, c.noise_share.to(median.dtype)), state.noise
    )
    return FloorSeen(free, ends, known), FloorState(level, noise, age)


def agree(both: Tensor, trusted: Tensor) -> Tensor:
    """Whether both eyes see one floor in enough of the cells that both see: `[..., 1, 1, 1]`, bool."""
    one, seen = ((cells.flatten(-3).sum(-1)) for cells in (both > 0, both >= 0))
    return ((one > 0) & (one >= trusted * seen))[..., None, None, None]


def stands(both: Tensor, upright: Tensor) -> Tensor:
    """Cells in which both eyes see no one floor, nor behind them, in so many bands: `[..., bands, blocks]`, bool."""
    from_here = both.flip(-2)
    floor_behind = (from_here > 0).cumsum(-2).flip(-2) > 0
    none = (from_here == 0).cumsum(-2).flip(-2)
    return (both == 0) & ~floor_behind & (none >= upright)


def beside_an_end(ends: Tensor) -> Tensor:
    """Cells next to a block that has ended here or nearer, on their inner side: `[..., bands, blocks]`, bool."""
    ended = ends.cumsum(-2) > 0
    return torch.cat((ended[..., 1:], torch.zeros_like(ended[..., :1])), -1)
