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
    """The patches of floor that are seen, and what floor looks like in them.

    Args:
        near_m: The floor is seen from this depth from the cameras on.
        far_m: The floor is seen up to this depth, rounded to whole bands.
        inner_rad: The patches begin in this direction, outward of the axis of their camera. It is negative, so that the
            two overlap ahead of the car.
        outer_rad: The patches end in this direction, outward of the axis of their camera.
        bands: A patch has this many bands of rows, nearest first.
        blocks: A patch has this many blocks of columns, outermost first.
        tolerance_ratio: A cell shows something else than floor when its output is more than this factor below or above
            what the floor gave lately at this speed.
        saturation_px: The output of floor reaches 63 % of its largest at this image speed, in pixels a step.
        standing_s: The car stands this long at the start, to measure the noise of the cameras.
        learning_s: The car then drives straight on this long, to learn what its floor looks like.
        adaptation_s: The car learns after that with this time constant, from cells that look like floor.
        min_signal_ratio: Floor is unknown where its low threshold is less than this many times the noise.
        min_correlation: A cell and the one behind it are one floor from this correlation of both images on.
        min_texture_ratio: One floor needs changes from pixel to pixel of at least this share of white.
        min_upright_bands: An object stands where both cameras see no one floor in this many bands of a block, and
            none behind.
        min_agreement_ratio: The cameras must agree on floor in this share of the cells that both see, to be believed
            about objects that stand.

    Raises:
        InputError: A number is out of range.
    """

    near_m: float = 0.65
    far_m: float = 1.38
    inner_rad: float = math.radians(-10.5)
    outer_rad: float = math.radians(29.2)
    bands: int = 14
    blocks: int = 8
    tolerance_ratio: float = 2.1
    saturation_px: float = 1.2
    standing_s: float = 0.1
    learning_s: float = 0.4
    adaptation_s: float = 5.0
    min_signal_ratio: float = 1.5
    min_correlation: float = 0.7
    min_texture_ratio: float = 0.002
    min_upright_bands: int = 3
    min_agreement_ratio: float = 0.25

    def __post_init__(self) -> None:
        free = {"inner_rad", "outer_rad", "standing_s", "min_texture_ratio", "min_agreement_ratio"}
        check_numbers(self, positive=set(vars(self)) - free, signed=("inner_rad", "outer_rad"))
        if not (self.near_m < self.far_m and -math.pi / 2 < self.inner_rad < self.outer_rad < math.pi / 2):
            raise InputError(f"expected near_m < far_m and inner_rad < outer_rad, got {self}")
        if self.bands < 2:
            raise InputError(f"bands must be 2 or more, got {self.bands}")
        if not (self.tolerance_ratio > 1 and self.min_correlation < 1 and self.min_agreement_ratio <= 1):
            raise InputError(
                f"expected tolerance_ratio > 1, min_correlation < 1 and min_agreement_ratio <= 1, got {self}"
            )


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

    bottom = math.floor(row(p.near_m)) + 1
    tall = (bottom - math.ceil(row(p.far_m))) // p.bands
    # Where the axes do not meet the middle of the frames, mirror images lie so many columns farther to the right.
    aside_px = round(2 * rig.center[0]) - (rig.width - 1)
    left = max(0, aside_px, math.ceil(column(p.outer_rad)))
    wide = (math.floor(column(p.inner_rad)) + 1 - left) // (p.blocks * EVERY) * EVERY
    top, right = bottom - tall * p.bands, left + wide * p.blocks
    if tall < 1 or wide < 1 or top < 0 or bottom > rig.height or right > rig.width + min(aside_px, 0):
        raise InputError(
            f"{p.bands} bands by {p.blocks} blocks of floor {p.near_m:g}-{p.far_m:g} m ahead do not fit into "
            f"{rig.width}x{rig.height} frames{rig.floor_hint(p.near_m)}; controller 'published' needs less floor, "
            "and StereoRanging none"
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
        min_correlation=float(params.min_correlation),
        min_texture=float(params.min_texture_ratio**2),
        min_change=MIN_CHANGE,
        max_gain=MAX_GAIN,
        dark=DARK,
    )
