"""Obstacles right ahead, nearer than the ranging sees: matching of both horizon rows, and the floor both cameras see.

Two farther poles may match as one near obstacle. An obstacle on the floor hides, in its columns of both images, all
floor behind it. If both cameras see one floor there, it is a mismatch. An obstacle that hangs, as a sofa does, hides
floor only farther out; so the farthest rows are compared, and many places that agree are kept all the same.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.navigation.body import Body
from ndtorch.navigation.stereo._kernels import Array, Frames, grey_fields, packed
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch.navigation.stereo.search import SearchParams, find_places
from ndtorch.navigation.stereo.strips import at_rects, row_rect
from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float32]

FOCAL, MIN_FOCAL = 215.0, 160.0
"""Focal length of shrunk rows, pixels: what is near is coarse. Rows of a shorter one than the second are not shrunk."""

MATCHING_COUNT = 64
MATCHING = SearchParams(
    count=MATCHING_COUNT,
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

MANY_PLACES = 12  # so many places or more are kept even where the floor seems to be unbroken
BEHIND = 1.1  # floor is compared from this many times the depth of an obstacle on, and from this depth on, m

MIN_DEPTH_M, MAX_DEPTH_M, HALF_WIDTH_M = 0.25, 0.95, 0.3
"""Obstacles nearer to the cameras than the first, for the car of [A], are not searched for, those farther than the
second are not near, and those farther to the side of the car's middle than the third are ignored."""

PAD_PX, GAP_PX, GROUP_MIN_PIXELS = 6, 8, 60
"""Columns to either side of an obstacle that are compared, gap between two obstacles, and fewest pixels."""


class Obstacles(NamedTuple):
    """Places of obstacles in the body frame, m, `[n]` each."""

    x: Floats
    y: Floats


class ProximityScan(NamedTuple):
    """What a proximity check finds, in the body frame."""

    obstacles: Obstacles  # that are near
    floor_seen: bool  # whether floor is seen right ahead
    across: Obstacles  # a line across the path: an obstacle is assumed there where no floor is seen
    mismatches: Obstacles  # places of ranges behind which floor is seen


NOWHERE = Obstacles(np.zeros(0, np.float32), np.zeros(0, np.float32))


class ProximityCheck:
    """Detects obstacles right before the car, and whether floor is seen there; in units of the body."""

    def __init__(self, rig: StereoRig, rects: tuple[Rect, Rect], body: Body | None = None) -> None:
        body = Body() if body is None else body
        self.rig, self.rects, self.row, self.size = rig, rects, (row_rect(rig),) * 2, (rig.height, rig.width)
        self.center, least_depth = rig.center[0], MIN_DEPTH_M * body.size_m / body.unit_m
        y = np.linspace(-HALF_WIDTH_M, HALF_WIDTH_M, 9, dtype=np.float32)
        self.across = Obstacles(np.full_like(y, rig.forward + least_depth), y)
        self.fold = fold = 1 if rig.focal < MIN_FOCAL else max(2, round(rig.focal / FOCAL))
        self.focal = rig.focal / fold / math.cos(rig.pitch)
        low = max(2, math.floor(self.focal * rig.baseline / MAX_DEPTH_M))
        high = math.ceil(self.focal * rig.baseline / least_depth)
        high = max(low + 2, min(rig.width // fold - 2 * MATCHING.half_width_px - 2, high))
        self.matching = packed(replace(MATCHING, min_disparity_px=low, max_disparity_px=high))
        one, other = rects
        self.corners, self.shape = (one.top, one.left, other.top, other.left), (2, *one.size)
        # A row sees (cos - down sin) ahead for every (sin + down cos) down, `down` being rows below center in focals.
        self.rows, self.horizon = np.arange(one.top, one.bottom), rig.center[1] - rig.focal * math.tan(rig.pitch)
        slant = 1 - (self.rows - rig.center[1]) / rig.focal * math.tan(rig.pitch)
        self.depth = rig.focal * rig.camera_height * slant / np.maximum(self.rows - self.horizon, 1.0)
        # The disparity of the floor grows by `baseline / height` pixels with every row below the horizon; that of a
        # wall is the same in all rows. Cameras that look up or down a little are allowed for.
        rows = self.rows[(self.depth >= FLOOR_NEAR_M) & (self.depth <= FLOOR_FAR_M)][::2]
        ratio, half = rig.focal / 430.0, FLOOR_HALF_WIDTH_M / rig.baseline
        most, self.least = round(MAX_TILT_PX * ratio), round(MIN_PIXELS * min(1.0, ratio) ** 2)
        tilts = np.array((0, *range(-most, most + 1, 2)))[:, None]
        shift = np.rint(rig.baseline / rig.camera_height * math.cos(rig.pitch) * (rows - self.horizon + tilts))
        # Columns of the left image straight ahead of the car.
        columns = self.center + shift / 2 - half * shift, self.center + shift / 2 + half * shift + 1
        self.spans = np.stack((np.broadcast_to(rows, shift.shape), shift, *columns), -1).astype(int)

    def __call__(self, frames: Frames, rows: Frames, ranges: Obstacles = NOWHERE) -> ProximityScan:
        """Obstacles that are near, and whether floor is seen straight ahead.

        A mismatch of the ranging is the same in every frame of a stationary car. So one near range where no obstacle is
        detected is a mismatch if floor is seen behind it.

        Args:
            frames, rows: of both cameras, whole or cut to subfields and rows.
            ranges: what was ranged, body frame.
        """
        images = np.empty(self.shape, np.float32)
        grey_fields(at_rects(frames, self.rects, self.size), 1, images)
        floor = correlation(*images, self.corners, self.spans, self.least, MIN_CORRELATION)
        floor_seen = floor >= MIN_CORRELATION
        obstacles, mismatches = self.on_floor(self.obstacles(rows), images), NOWHERE
        near = (ranges.x - self.rig.forward < MAX_DEPTH_M) & (np.abs(ranges.y) <= HALF_WIDTH_M)
        if floor_seen and near.sum() == 1 and not len(obstacles.x):
            one = Obstacles(ranges.x[near], ranges.y[near])
            mismatches = NOWHERE if len(self.on_floor(one, images).x) else one
        return ProximityScan(obstacles, floor_seen, self.across, mismatches)

    def obstacles(self, rows: Frames) -> Obstacles:
        """Obstacles that are near, whatever the floor shows: textured places of the left row in the right one."""
        rig, fold = self.rig, self.fold
        left, right = near_places(at_rects(rows, self.row, self.size), fold, rig.width // fold, self.matching)
        depth = self.focal * rig.baseline / (left - right)
        aside = rig.baseline / 2 + depth * ((self.center - (fold - 1) / 2) / fold - left) / self.focal
        kept = np.abs(aside) <= HALF_WIDTH_M
        return Obstacles(rig.forward + depth[kept], aside[kept])

    def on_floor(self, obstacles: Obstacles, images: Floats) -> Obstacles:
        """Obstacles without those behind which both subfields `[2, h, w]` show one floor."""
        if not 0 < len(obstacles.x) < MANY_PLACES:
            return obstacles
        rig, depth = self.rig, obstacles.x - self.rig.forward
        column = self.center + rig.focal * (rig.baseline / 2 - obstacles.y) / depth
        order, kept = np.argsort(column), np.ones(len(depth), bool)
        gap = (np.diff(column[order]) > GAP_PX) | (np.abs(np.diff(depth[order])) > 0.15 * depth[order][1:])
        for group in np.split(order, np.flatnonzero(gap) + 1):
            behind = self.rows[self.depth > max(BEHIND * float(np.median(depth[group])), BEHIND)]
            ends = column[group].min() - PAD_PX, column[group].max() + PAD_PX + 1
            shift = np.rint(rig.baseline / rig.camera_height * (behind - self.horizon))
            spans = np.stack((behind, shift, np.full_like(shift, ends[0]), np.full_like(shift, ends[1])), 1)
            spans = spans[None].astype(int)
            kept[group] = correlation(*images, self.corners, spans, GROUP_MIN_PIXELS, UNBROKEN) < UNBROKEN
        return Obstacles(obstacles.x[kept], obstacles.y[kept])


@jit
def near_places(frames: Frames, fold: int, width: int, numbers: Array) -> Array:
    """Left and right columns of places that both rows show, in pixels of the mean of `fold` each, `[2, n]`."""
    grey, shrunk = np.empty((2, 1, width * fold), np.float32), np.empty((2, 1, width), np.float32)
    grey_fields(frames, 1, grey)
    for eye in range(2):
        for x in range(width):
            shrunk[eye, 0, x] = grey[eye, 0, fold * x : fold * (x + 1)].mean()
    found = np.empty((3, MATCHING_COUNT), np.float32)
    find_places(shrunk, numbers, found)
    return found[:2, found[0] > 0]


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
