"""Where the floor ends: cells of both subfields, judged by whether they look like floor that moves past."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.navigation.rig import Rect, StereoRig
from ndtorch.navigation.strips import check_unit_range, grey_pair
from ndtorch.vision.nondirectional import SPEED_SCALE, NDMin
from ndtorch.vision.temporal import FilterState


@dataclass(frozen=True)
class FloorParams:
    """The subfields of `FloorMotion` and what floor looks like in them.

    Args:
        near, far: the subfields see the floor at these depths from the camera, m; `far` is rounded to bands.
        inner, outer: directions they reach to, radians outward of the camera's axis; inner is negative, so
            that the two overlap ahead of the car.
        bands, blocks: cells of a subfield, bands of rows (nearest first) by blocks of columns (outermost first).
        tolerance: a cell shows something else than floor when its output is more than this factor below or
            above what the floor gave lately at this speed.
        saturation: image speed, pixels a step, at which the output of floor has reached 63 % of its largest.
        standing_time: the car stands this long at the start, s, to measure the noise of the cameras.
        learning_time: then it drives straight this long, s, to learn what its floor looks like.
        adaptation: time constant of learning after that, from cells that look like floor, s.
        clear: floor is unknown where its low threshold is less than this many times the noise.
    """

    near: float = 0.65
    far: float = 1.38
    inner: float = math.radians(-10.5)
    outer: float = math.radians(29.2)
    bands: int = 14
    blocks: int = 8
    tolerance: float = 2.1
    saturation: float = 1.2
    standing_time: float = 0.1
    learning_time: float = 0.4
    adaptation: float = 5.0
    clear: float = 1.5

    def __post_init__(self) -> None:
        if not (0 < self.near < self.far < math.inf and -math.pi / 2 < self.inner < self.outer < math.pi / 2):
            raise InputError(f"expected 0 < near < far and inner < outer, got {self}")
        if self.bands < 2 or self.blocks < 1:
            raise InputError(f"expected bands >= 2 and blocks >= 1, got {self.bands} and {self.blocks}")
        if not (self.tolerance > 1 and self.saturation > 0 and self.adaptation > 0 and self.clear > 0):
            raise InputError(f"expected tolerance > 1 and positive saturation, adaptation and clear, got {self}")
        if not (0 <= self.standing_time < math.inf and 0 < self.learning_time < math.inf):
            raise InputError(f"expected standing_time >= 0 and learning_time > 0, got {self}")


EVERY = 2
"""Only every second column of a subfield is read: the largest output of a cell is hardly less."""


class FloorView(NamedTuple):
    """Geometry of the cells, all tables of plain tensors.

    Attributes:
        rects: subfields of the left and the right image.
        depth: of the middle of each band ahead of the cameras, m, `[bands]`, nearest first.
        x, y: floor at the middle of each cell in the body frame, m, `[2, bands, blocks]`, left image first.
        sweep: image speed of the floor in each band when driving 1 m/s, pixels a second, `[bands]`.
    """

    rects: tuple[Rect, Rect]
    depth: Tensor
    x: Tensor
    y: Tensor
    sweep: Tensor


def floor_view(rig: StereoRig, params: FloorParams) -> FloorView:
    """Lay the cells out: whole pixels, equal cells, mirror images of each other.

    Raises:
        InputError: cells that do not fit into the frame.
    """
    p = params

    def row(depth: float) -> float:
        return float(rig.project(torch.tensor(depth), torch.tensor(0.0), -rig.camera_height)[1])

    def column(angle: float) -> float:
        return (rig.width - 1) / 2 - rig.focal * math.tan(angle)

    bottom = math.floor(row(p.near)) + 1
    tall = (bottom - math.ceil(row(p.far))) // p.bands
    left = max(0, math.ceil(column(p.outer)))
    wide = (math.floor(column(p.inner)) + 1 - left) // (p.blocks * EVERY) * EVERY
    top, right = bottom - tall * p.bands, left + wide * p.blocks
    if tall < 1 or wide < 1 or top < 0 or bottom > rig.height or right > rig.width:
        raise InputError(
            f"{p.bands} bands by {p.blocks} blocks of floor {p.near}-{p.far} m ahead do not fit into "
            f"{rig.width}x{rig.height} frames"
        )
    rects = Rect(top, bottom, left, right), Rect(top, bottom, rig.width - right, rig.width - left)
    rows = bottom - 0.5 - tall * (torch.arange(p.bands, dtype=torch.float64) + 0.5)
    down = (rows - (rig.height - 1) / 2) / rig.focal
    # The ray through the row: (cos - down sin) ahead for every (sin + down cos) down.
    cos, sin = math.cos(rig.pitch), math.sin(rig.pitch)
    depth = rig.camera_height * (cos - down * sin) / (sin + down * cos)
    columns = left - 0.5 + wide * (torch.arange(p.blocks, dtype=torch.float64) + 0.5)
    # Columns go with y over the depth along the axis, which a pitch makes differ from the way along the floor.
    along = depth * cos + rig.camera_height * sin
    slope = ((rig.width - 1) / 2 - columns) / rig.focal
    aside = rig.baseline / 2 + along[:, None] * slope
    x = (rig.forward + depth)[:, None].expand(p.bands, p.blocks)
    sweep = rig.focal * rig.camera_height / along.square()
    dtype = torch.get_default_dtype()
    return FloorView(
        rects, depth.to(dtype), torch.stack((x, x)).to(dtype), torch.stack((aside, -aside)).to(dtype), sweep.to(dtype)
    )


class FloorMotion(nn.Module):
    """Speed of the image in the cells of both subfields: ND-min, largest |output| of each cell.

    Shapes:
        left, right: frames `[..., T, C, H, W]`, or cut to the subfields, as `SubfieldMotion`
            -> `[..., T, 2, bands, blocks]`, left image first, nearest band and outermost block first, in
            the units of the thresholds of [A], raw output x 20.
        State: the pixels read, every second column of the subfields; `None` settles on the first frame.

    Args:
        rig: the camera pair.
        dt: time step, s.
        params: the cells.
        tau_high: time constant of the high-pass, s.

    Raises:
        InputError: frames that cannot be used, or NaN, infinity or values far beyond 1 in the subfields.
    """

    def __init__(self, rig: StereoRig, dt: float, params: FloorParams | None = None, tau_high: float = 0.005) -> None:
        super().__init__()
        self.params = params or FloorParams()
        self.view = floor_view(rig, self.params)
        self.fields = self.view.rects
        self.size = (rig.height, rig.width)
        self.nd_min = NDMin(tau_high, dt)

    def forward(self, left: Tensor, right: Tensor, state: FilterState | None = None) -> tuple[Tensor, FilterState]:
        pair = grey_pair(left, right, *self.fields, self.size, EVERY)
        motion, state = self.nd_min(pair, state)
        bands, blocks = self.params.bands, self.params.blocks
        # One dimension after the other: much faster than both at once.
        cells = motion.abs().unflatten(-2, (bands, -1)).amax(-2).unflatten(-1, (blocks, -1)).amax(-1)
        check_unit_range(cells, left)
        ours, theirs = cells.mul(SPEED_SCALE).unbind(-3)
        # From the top row down to the bottom one first: the nearest band shall be the first, the outermost block too.
        return torch.stack((ours.flip(-2), theirs.flip((-2, -1))), -3), state


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
    rest = map(torch.tensor, (0.1, 0.02, 0.3, 1.0))
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
    """One time step: which cells look like floor that moves as the car does, and learning what floor looks like.

    Output grows with image speed v as `level (1 - exp(-v / saturation))`; the level follows the floor. A blank
    wall gives less, the foot of a wall and a textured wall more.

    Args:
        cells: outputs of `FloorMotion` at one time, `[..., 2, bands, blocks]`.
        speed, curvature: what the car drove since the last frame, `[...]`.
    """
    c = constants
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
    free = floor.to(cells.dtype).cumprod(-2)
    reached = torch.cat((torch.ones_like(free[..., :1, :]), free[..., :-1, :]), -2)
    ends = (reached - free) * sure

    # What looks like floor teaches what floor looks like; at the start most of the nearest cells are floor.
    level = state.level * torch.exp((free * excess).sum((-3, -1)) * c.share)
    near = max(1, cells.shape[-2] * 2 // 5)
    steady = cells / shape.clamp(min=c.moving).unsqueeze(-1).unsqueeze(-3)
    median = steady[..., :near, :].flatten(-3).median(-1).values.unsqueeze(-1) * c.profile
    first = torch.where(state.level > 0, torch.lerp(state.level, median, c.learn_share), median)
    moving = ((age > c.standing) & (speed > c.moving)).unsqueeze(-1)
    level = torch.where(learning, torch.where(moving, first, state.level), level)
    median_now = cells.flatten(-3).median(-1).values
    noise = torch.where(speed < c.still, torch.lerp(state.noise, median_now, c.noise_share), state.noise)
    return FloorSeen(free, ends, known), FloorState(level, noise, age)
