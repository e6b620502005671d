"""Where the cells of floor lie in both images."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.errors import InputError
from ndtorch.navigation.stereo._kernels import Array
from ndtorch.navigation.stereo.rig import Rect, StereoRig

INNER, OUTER = math.radians(-10.5), math.radians(29.2)
"""Directions between which the patches lie, outward of the axis of their camera: the two overlap ahead of the car."""

NEAR_M, FAR_M, BANDS, BLOCKS = 0.65, 1.38, 14, 8
"""Depths from the cameras between which the floor is seen, and bands of rows and blocks of columns of a patch, fewer
bands where there are fewer rows."""

EVERY = 2
"""Only every second column of a patch is read, and every second row compared with the other camera's."""


class FloorView(NamedTuple):
    """Geometry of the cells."""

    # that are read of the left and the right image: the cells, and inward of them what the other eye needs
    # to see the floor of its own cells a second time
    rects: tuple[Rect, Rect]
    # columns that are read before those of the cells, in the left and the right image, and in all
    reads: tuple[int, int, int]
    shape: tuple[int, int, int]  # of the pixels of the cells, `[2, h, w]`
    bands: int  # how many there are, no more than rows
    depth: Array  # of the middle of each band ahead of the cameras, m, `[bands]`, nearest first
    # x, y: floor at the middle of each cell in the body frame, m, `[2, bands, blocks]`, left image first
    x: Array
    y: Array
    sweep: Array  # image speed of the floor in each band when driving 1 m/s, pixels a second, `[bands]`
    # columns that are read, from a place of the left rectangle to that of the right one that sees the same
    # floor, in every row, `[h]`
    shift: Array


def floor_view(rig: StereoRig) -> FloorView:
    """Lay the cells out: whole pixels, equal cells, mirror images of each other.

    Raises:
        InputError: cells that do not fit into the frame.
    """
    (middle, level), height = rig.center, rig.camera_height
    cos, sin = math.cos(rig.pitch), math.sin(rig.pitch)
    near, far = (
        level + rig.focal * (height * cos - depth * sin) / (depth * cos + height * sin) for depth in (NEAR_M, FAR_M)
    )
    bottom = math.floor(near) + 1
    bands = min(BANDS, max(2, bottom - math.ceil(far)))
    tall = (bottom - math.ceil(far)) // bands
    # Where the axes do not meet the middle of the frames, mirror images lie so many columns farther to the right.
    aside_px = round(2 * middle) - (rig.width - 1)
    left = max(0, aside_px, math.ceil(middle - rig.focal * math.tan(OUTER)))
    wide = (math.floor(middle - rig.focal * math.tan(INNER)) + 1 - left) // (BLOCKS * EVERY) * EVERY
    top, right, end = bottom - tall * bands, left + wide * BLOCKS, rig.width + min(aside_px, 0)
    if tall < 1 or wide < 1 or top < 0 or bottom > rig.height or right > end:
        raise InputError(
            f"{bands} bands by {BLOCKS} blocks of floor {NEAR_M:g}-{FAR_M:g} m ahead do not fit into "
            f"{rig.width}x{rig.height} frames{rig.floor_hint(NEAR_M)}; controller 'published' needs less floor, "
            "and StereoRanging none"
        )
    mirror = rig.width + aside_px
    end -= (end - right) % EVERY
    rects = Rect(top, bottom, left, end), Rect(top, bottom, mirror - end, mirror - left)
    rows = bottom - 0.5 - tall * (np.arange(bands) + 0.5)
    down = (rows - level) / rig.focal
    # The ray through the row: (cos - down sin) ahead for every (sin + down cos) down.
    depth = height * (cos - down * sin) / (sin + down * cos)
    columns = left - 0.5 + wide * (np.arange(BLOCKS) + 0.5)
    # Columns go with y over the depth along the axis, which a pitch makes differ from the way along the floor.
    along = depth * cos + height * sin
    aside = rig.baseline / 2 + along[:, None] * (middle - columns) / rig.focal
    x = np.broadcast_to((rig.forward + depth)[:, None], aside.shape)
    below = (np.arange(top, bottom) - level) / rig.focal
    disparity = rig.focal * rig.baseline / (height / (sin + below * cos))
    cells = (2, bottom - top, wide * BLOCKS // EVERY)
    return FloorView(
        rects,
        (0, (end - right) // EVERY, (end - left) // EVERY),
        cells,
        bands,
        depth,
        np.stack((x, x)),
        np.stack((aside, -aside)),
        rig.focal * height / along**2,
        np.rint((left - rects[1].left - disparity) / EVERY).astype(np.int64),
    )
