"""The patches of floor that the ranging controller looks at: cells of pixels, and where they are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.controllers.ranging._kernels_floor import ViewNumbers
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch.vision.nondirectional import SPEED_SCALE
from ndtorch.vision.temporal import smoothing_factor


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
        alike: correlation of both images from which on a cell, and the one behind it, are one floor.
        texture: least change from pixel to pixel for that, as a share of white.
        standing: something stands where both eyes see no one floor in so many bands of a block, and none behind.
        trusted: share of the cells seen by both eyes in which they must agree on floor to be believed about that.
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
    alike: float = 0.7
    texture: float = 0.002
    standing: int = 3
    trusted: float = 0.25

    def __post_init__(self) -> None:
        check_numbers(self)
        if not (0 < self.near < self.far and -math.pi / 2 < self.inner < self.outer < math.pi / 2):
            raise InputError(f"expected 0 < near < far and inner < outer, got {self}")
        if self.bands < 2 or self.blocks < 1:
            raise InputError(f"expected bands >= 2 and blocks >= 1, got {self.bands} and {self.blocks}")
        if not (self.tolerance > 1 and self.saturation > 0 and self.adaptation > 0 and self.clear > 0):
            raise InputError(f"expected tolerance > 1 and positive saturation, adaptation and clear, got {self}")
        if not (0 < self.alike < 1 and self.texture >= 0):
            raise InputError(f"expected 0 < alike < 1 and texture >= 0, got {self.alike} and {self.texture}")
        if self.standing < 1:
            raise InputError(f"expected standing >= 1, got {self.standing}")
        if not 0 <= self.trusted <= 1:
            raise InputError(f"expected trusted in 0..1, got {self.trusted}")
        if not (self.standing_time >= 0 and self.learning_time > 0):
            raise InputError(f"expected standing_time >= 0 and learning_time > 0, got {self}")


EVERY = 2
"""Only every second column of a subfield is read: the largest output of a cell is hardly less."""


class FloorView(NamedTuple):
    """Geometry of the cells, all tables of plain tensors.

    Attributes:
        rects: that are read of the left and the right image: the cells, and inward of them what the other eye
            needs to see the floor of its own cells a second time.
        cells: of these the parts that have cells.
        depth: of the middle of each band ahead of the cameras, m, `[bands]`, nearest first.
        x, y: floor at the middle of each cell in the body frame, m, `[2, bands, blocks]`, left image first.
        sweep: image speed of the floor in each band when driving 1 m/s, pixels a second, `[bands]`.
    """

    rects: tuple[Rect, Rect]
    cells: tuple[Rect, Rect]
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
        return rig.center[0] - rig.focal * math.tan(angle)

    bottom = math.floor(row(p.near)) + 1
    tall = (bottom - math.ceil(row(p.far))) // p.bands
    # Where the axes do not meet the middle of the frames, mirror images lie so many columns farther to the right.
    aside_px = round(2 * rig.center[0]) - (rig.width - 1)
    left = max(0, aside_px, math.ceil(column(p.outer)))
    wide = (math.floor(column(p.inner)) + 1 - left) // (p.blocks * EVERY) * EVERY
    top, right = bottom - tall * p.bands, left + wide * p.blocks
    if tall < 1 or wide < 1 or top < 0 or bottom > rig.height or right > rig.width + min(aside_px, 0):
        raise InputError(
            f"{p.bands} bands by {p.blocks} blocks of floor {p.near}-{p.far} m ahead do not fit into "
            f"{rig.width}x{rig.height} frames"
        )
    mirror = rig.width + aside_px
    cells = Rect(top, bottom, left, right), Rect(top, bottom, mirror - right, mirror - left)
    end = rig.width + min(aside_px, 0)
    end -= (end - right) % EVERY
    rects = Rect(top, bottom, left, end), Rect(top, bottom, mirror - end, mirror - left)
    rows = bottom - 0.5 - tall * (torch.arange(p.bands, dtype=torch.float64) + 0.5)
    down = (rows - rig.center[1]) / rig.focal
    # The ray through the row: (cos - down sin) ahead for every (sin + down cos) down.
    cos, sin = math.cos(rig.pitch), math.sin(rig.pitch)
    depth = rig.camera_height * (cos - down * sin) / (sin + down * cos)
    columns = left - 0.5 + wide * (torch.arange(p.blocks, dtype=torch.float64) + 0.5)
    # Columns go with y over the depth along the axis, which a pitch makes differ from the way along the floor.
    along = depth * cos + rig.camera_height * sin
    slope = (rig.center[0] - columns) / rig.focal
    aside = rig.baseline / 2 + along[:, None] * slope
    x = (rig.forward + depth)[:, None].expand(p.bands, p.blocks)
    sweep = rig.focal * rig.camera_height / along.square()
    dtype = torch.get_default_dtype()
    return FloorView(
        rects,
        cells,
        depth.to(dtype),
        torch.stack((x, x)).to(dtype),
        torch.stack((aside, -aside)).to(dtype),
        sweep.to(dtype),
    )


ROWS = 2
"""Only every second row is compared with the other camera's."""

MIN_CHANGE, MAX_GAIN, DARK = 0.01, 2.0, 0.01
"""Illumination: changes up to the first share are left alone, as much comes from texture that moves past; no lamp
changes by more than the second factor from one frame to the next; means below the third say nothing of the light."""


def view_numbers(
    rig: StereoRig, params: FloorParams, view: FloorView, dt: float, tau_high: float = 0.005
) -> ViewNumbers:
    """What `see_floor` looks at."""
    (ours, theirs), cells = view.rects, view.cells
    rows = np.arange(0, ours.bottom - ours.top, ROWS)
    down = (ours.top + rows - rig.center[1]) / rig.focal
    # Depth along the axis of the floor in a row, as in `floor_view`.
    along = rig.camera_height / (math.sin(rig.pitch) + down * math.cos(rig.pitch))
    disparity = rig.focal * rig.baseline / along
    return ViewNumbers(
        rows=rows,
        shift=np.round((ours.left - theirs.left - disparity) / EVERY).astype(np.int64),
        first_left=(cells[0].left - ours.left) // EVERY,
        first_right=(cells[1].left - theirs.left) // EVERY,
        columns=(ours.right - ours.left) // EVERY,
        wide=(cells[0].right - cells[0].left) // EVERY // params.blocks,
        tall=(cells[0].bottom - cells[0].top) // params.bands,
        bands=params.bands,
        blocks=params.blocks,
        every=EVERY,
        a=smoothing_factor(tau_high, dt),
        scale=float(SPEED_SCALE),
        min_correlation=float(params.alike),
        min_texture=float(params.texture**2),
        min_change=MIN_CHANGE,
        max_gain=MAX_GAIN,
        dark=DARK,
    )
