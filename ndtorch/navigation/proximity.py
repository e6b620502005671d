"""Obstacles right ahead, nearer than the ranging sees: matching of both horizon rows, and the floor both cameras see.

Two farther poles may match as one near obstacle. An obstacle on the floor hides, in its columns of both images, all
floor behind it. If both cameras see one floor there, it is a mismatch. An obstacle that hangs, as a sofa does, hides
floor only farther out; so the farthest rows are compared, and many places that agree are kept all the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.body import Body
from ndtorch.navigation.stereo._kernels import Array, packed
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch.navigation.stereo.search import SearchParams, find_places
from ndtorch.navigation.stereo.strips import grey_pair, row_rect
from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float32]
Pair = tuple[Tensor, Tensor]

FOCAL, MIN_FOCAL = 215.0, 160.0
"""Focal length of shrunk rows, pixels: what is near is coarse. Rows of a shorter one than the second are not shrunk."""

MATCHING = SearchParams(
    count=64,
    rows=1,
    half_width_px=6,
    mean_half_width_px=0,
    uniqueness_ratio=0.7,
    min_step_ratio=0.001,
    agreement_ratio=0.4,
    spacing_px=0,
)
"""Search of shrunk rows; disparities follow from the rig. Means stay: equal steps of other brightness do not match."""

FLOOR_NEAR_M, FLOOR_FAR_M, FLOOR_HALF_WIDTH_M = 0.8, 1.15, 0.15
"""The floor ahead is compared from and up to these depths, and so far to either side of the car's middle."""

MIN_CORRELATION, UNBROKEN = 0.7, 0.95
"""Both cameras see one floor from the first correlation on; from the second on there is no obstacle on it."""

MAX_TILT_PX = 26
"""The horizon may be this many rows higher or lower than the rig gives it, at a focal length of 430 pixels."""

MIN_COLUMNS, MIN_SIGMA, MIN_PIXELS = 5, 0.002, 150
"""Rows with fewer columns in both images are left out; the correlation is 0 below this standard deviation of the
brightness, and with fewer pixels at a focal length of 430; shorter ones need less, in proportion to the area."""

MANY_PLACES = 12
"""So many places or more are kept even where the floor seems to be unbroken."""

BEHIND = 1.1
"""Floor is compared from this many times the depth of an obstacle on, and from this depth on, m."""

PAD_PX, GAP_PX, GROUP_MIN_PIXELS = 6, 8, 60
"""Columns to either side of an obstacle that are compared, gap between two obstacles, and fewest pixels."""


@dataclass(frozen=True)
class ProximityParams:
    """Where the proximity check looks.

    Args:
        min_depth_m: Obstacles nearer to the cameras than this are not searched for.
        max_depth_m: Obstacles farther from the cameras than this are not near.
        half_width_m: Obstacles farther to the side of the car's middle than this are ignored.

    Raises:
        InputError: A number is out of range.
    """

    min_depth_m: float = 0.25
    max_depth_m: float = 0.95
    half_width_m: float = 0.3

    def __post_init__(self) -> None:
        check_numbers(self, positive=vars(self))
        if not self.min_depth_m < self.max_depth_m:
            raise InputError(f"expected min_depth_m < max_depth_m, got {self}")


class Obstacles(NamedTuple):
    """Places of obstacles in the body frame, m, `[n]` each."""

    x: Floats
    y: Floats


class ProximityScan(NamedTuple):
    """What a proximity check finds, in the body frame.

    Attributes:
        obstacles: that are near.
        floor_seen: whether floor is seen right ahead.
        across: a line across the path: an obstacle is assumed there where no floor is seen.
        mismatches: places of ranges behind which floor is seen.
    """

    obstacles: Obstacles
    floor_seen: bool
    across: Obstacles
    mismatches: Obstacles


NOWHERE = Obstacles(np.zeros(0, np.float32), np.zeros(0, np.float32))


class ProximityCheck:
    """Detects obstacles right before the car, and whether floor is seen there.

    Args:
        rig: the camera pair; with a body, its lengths and all results are in units of that.
        rects: the subfields of both images.
        body: of the robot; the car of [A] by default.
    """

    def __init__(self, rig: StereoRig, rects: tuple[Rect, Rect], body: Body | None = None) -> None:
        body = Body() if body is None else body
        self.rig, self.rects, self.row = rig, rects, row_rect(rig)
        self.params = p = ProximityParams(min_depth_m=ProximityParams.min_depth_m * body.size_m / body.unit_m)
        y = np.linspace(-p.half_width_m, p.half_width_m, 9, dtype=np.float32)
        self.across = Obstacles(np.full_like(y, rig.forward + p.min_depth_m), y)
        self.fold = fold = 1 if rig.focal < MIN_FOCAL else max(2, round(rig.focal / FOCAL))
        self.focal = rig.focal / fold / math.cos(rig.pitch)
        low = max(2, math.floor(self.focal * rig.baseline / p.max_depth_m))
        high = math.ceil(self.focal * rig.baseline / p.min_depth_m)
        high = max(low + 2, min(rig.width // fold - 2 * MATCHING.half_width_px - 2, high))
        self.matching = packed(replace(MATCHING, min_disparity_px=low, max_disparity_px=high))

    def __call__(self, fields: Pair, rows: Pair, ranges: Obstacles = NOWHERE) -> ProximityScan:
        """Obstacles that are near, and whether floor is seen straight ahead.

        A mismatch of the ranging is the same in every frame of a stationary car. So one near range where no obstacle is
        detected is a mismatch if floor is seen behind it.

        Args:
            fields, rows: of the left and the right camera, frames `[C, H, W]`, whole or cut.
            ranges: what was ranged, body frame.
        """
        size, p = (self.rig.height, self.rig.width), self.params
        images = grey_pair(fields[0][None], fields[1][None], *self.rects, size)[0].float().numpy()
        floor_seen = floor_correlation(images[0], images[1], self.rects, self.rig) >= MIN_CORRELATION
        obstacles, mismatches = self.on_floor(self.obstacles(rows), images), NOWHERE
        near = (ranges.x - self.rig.forward < p.max_depth_m) & (np.abs(ranges.y) <= p.half_width_m)
        if floor_seen and near.sum() == 1 and not len(obstacles.x):
            one = Obstacles(ranges.x[near], ranges.y[near])
            mismatches = NOWHERE if len(self.on_floor(one, images).x) else one
        return ProximityScan(obstacles, floor_seen, self.across, mismatches)

    def obstacles(self, rows: Pair) -> Obstacles:
        """Obstacles that are near, whatever the floor shows; rows are frames `[C, H, W]`, whole or cut."""
        grey = grey_pair(rows[0][None], rows[1][None], self.row, self.row, (self.rig.height, self.rig.width))
        return self.detect(grey[0, :, 0].float().numpy())

    def detect(self, pair: Floats) -> Obstacles:
        """Obstacles in both rows `[2, W]`: every textured place of the left one is matched with the right one."""
        rig, p, fold = self.rig, self.params, self.fold
        width = pair.shape[1] // fold
        shrunk = pair[:, : width * fold].reshape(2, 1, width, fold).mean(-1)
        found = np.empty((3, MATCHING.count), np.float32)
        find_places(np.ascontiguousarray(shrunk), self.matching, found)
        left, right = found[:2, found[0] > 0]
        depth = self.focal * rig.baseline / (left - right)
        aside = rig.baseline / 2 + depth * ((rig.center[0] - (fold - 1) / 2) / fold - left) / self.focal
        kept = np.abs(aside) <= p.half_width_m
        return Obstacles(rig.forward + depth[kept], aside[kept])

    def on_floor(self, obstacles: Obstacles, images: Floats) -> Obstacles:
        """Obstacles without those behind which both subfields `[2, h, w]` show one floor."""
        if not 0 < len(obstacles.x) < MANY_PLACES:
            return obstacles
        rig, (rect, _) = self.rig, self.rects
        depth = obstacles.x - rig.forward
        column = rig.center[0] + rig.focal * (rig.baseline / 2 - obstacles.y) / depth
        order = np.argsort(column)
        gap = (np.diff(column[order]) > GAP_PX) | (np.abs(np.diff(depth[order])) > 0.15 * depth[order][1:])
        rows, kept = np.arange(rect.top, rect.bottom), np.ones(len(obstacles.x), bool)
        floor = floor_depth(rows, rig)
        for group in np.split(order, np.flatnonzero(gap) + 1):
            behind = rows[floor > max(BEHIND * float(np.median(depth[group])), BEHIND)]
            ends = column[group].min() - PAD_PX, column[group].max() + PAD_PX + 1
            shift = np.rint(rig.baseline / rig.camera_height * (behind - horizon(rig)))
            spans = np.stack((behind, shift, np.full_like(shift, ends[0]), np.full_like(shift, ends[1])), 1)
            spans = spans[None].astype(int)
            kept[group] = correlation(*images, corners(self.rects), spans, GROUP_MIN_PIXELS, UNBROKEN) < UNBROKEN
        return Obstacles(obstacles.x[kept], obstacles.y[kept])


def horizon(rig: StereoRig) -> float:
    """The row of the horizon, in fractions of a pixel."""
    return rig.center[1] - rig.focal * math.tan(rig.pitch)


def floor_depth(rows: npt.NDArray[Any], rig: StereoRig) -> npt.NDArray[Any]:
    """Depth of the floor in rows, m."""
    # A row sees (cos - down sin) ahead for every (sin + down cos) down, `down` being rows below the center in focals.
    slant = 1 - (rows - rig.center[1]) / rig.focal * math.tan(rig.pitch)
    return np.asarray(rig.focal * rig.camera_height * slant / np.maximum(rows - horizon(rig), 1.0))


def floor_correlation(left: Floats, right: Floats, rects: tuple[Rect, Rect], rig: StereoRig) -> float:
    """Correlation of the floor straight ahead in both images; 0 if too little is seen.

    The disparity of the floor grows by `baseline / height` pixels with every row below the horizon; that of a wall is
    the same in all rows. Cameras that look up or down a little are allowed for.

    Args:
        left, right: subfields `[h, w]` in 0..1.
        rects: their places in the images.
    """
    rows = np.arange(rects[0].top, rects[0].bottom)
    depth = floor_depth(rows, rig)
    rows = rows[(depth >= FLOOR_NEAR_M) & (depth <= FLOOR_FAR_M)][::2]
    ratio, center, half = rig.focal / 430.0, rig.center[0], FLOOR_HALF_WIDTH_M / rig.baseline
    most, least = round(MAX_TILT_PX * ratio), round(MIN_PIXELS * min(1.0, ratio) ** 2)
    tilts = np.array((0, *range(-most, most + 1, 2)))[:, None]
    shift = np.rint(rig.baseline / rig.camera_height * math.cos(rig.pitch) * (rows - horizon(rig) + tilts))
    # Columns of the left image straight ahead of the car.
    columns = center + shift / 2 - half * shift, center + shift / 2 + half * shift + 1
    spans = np.stack((np.broadcast_to(rows, shift.shape), shift, *columns), -1).astype(int)
    return correlation(left, right, corners(rects), spans, least, MIN_CORRELATION)


def corners(rects: tuple[Rect, Rect]) -> tuple[int, int, int, int]:
    one, other = rects
    return one.top, one.left, other.top, other.left


@jit
def correlation(
    left: Array, right: Array, corners: tuple[int, int, int, int], spans: Array, least: int, enough: float
) -> float:
    """Correlation of two subfields in rows of floor, less the means of each row; 0 if too little is seen.

    Args:
        left, right: `[h, w]`, which begin at `corners`: top and left of the one, of the other.
        spans: row of the image, disparity, and columns of the left image from and up to, `[tilts, n, 4]`; the largest
            correlation counts, and no further one is tried once it is `enough`.
        least: pixels that are compared, at least.
    """
    top, begin, other_top, other_begin = corners
    best = 0.0
    for t in range(spans.shape[0]):
        count, both, square, other = 0, 0.0, 0.0, 0.0
        for row, shift, start, stop in spans[t]:
            first, last = max(start, begin, other_begin + shift), min(stop, begin + left.shape[1])
            last = min(last, other_begin + shift + right.shape[1])
            if last - first < MIN_COLUMNS:
                continue
            a = left[row - top, first - begin : last - begin]
            b = right[row - other_top, first - shift - other_begin : last - shift - other_begin]
            # Less the means of the row, since the foot of a wall lies in one row of both images.
            mean, other_mean = a.mean(), b.mean()
            count += last - first
            for x in range(last - first):
                one, two = a[x] - mean, b[x] - other_mean
                both, square, other = both + one * two, square + one * one, other + two * two
        if count >= max(1, least) and min(square, other) > count * MIN_SIGMA**2:
            best = max(best, both / math.sqrt(square * other))
        if best >= enough:
            break
    return best
