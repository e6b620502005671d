"""Do both cameras still see the same floor? Then they are mounted correctly, whatever else matches by chance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ndtorch.navigation import Strips
from ndtorch.navigation.proximity.floor_consistency import floor_correlation
from ndtorch.navigation.proximity.params import ProximityParams
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch_robot.camera_monitor.image_quality import Floats, one_color
from ndtorch_robot.camera_monitor.mounting_check import EVERY, MAX_DISPARITY, Position, is_new_view

SEEN = 0.7
"""Correlation from which both cameras see one floor."""

MIN_CLARITY = 0.5
"""In the dark noise lowers the correlation: `SEEN` times the clarity is enough where the clarity is this high. At a
quarter of the light this held for 0.99 of 462 comparisons of good cameras, and for none with an upside-down one."""

UPSIDE_DOWN_MARGIN = 0.3
"""By how much the correlation must be lower with one image rotated by 180 degrees."""

LOST = 0.5
"""Correlation, as a ratio to the clarity, below which both do not see one floor."""

CLEAR = 0.6
"""Correlation of neighbouring pixels of the floor below which it is noise, or too fine, and says nothing."""

DEPTH_RATIO = 1.3
"""The nearest floor is compared: up to this multiple of the depth of its nearest row."""

HALF_WIDTH = 0.3
"""Distance compared to either side of the middle of the car, m."""

SURE_TILT, MAX_TILT = 8, 26
"""Rows by which the horizon may lie higher or lower for a certain verdict (a bump, or a camera turned by 1.5 degrees),
and at all (cameras that look up or down by 3 degrees)."""

BEFORE = 6
"""Comparisons in a row that must have seen one floor before it can be lost."""

VIEWS = 20
"""Views in a row without one floor after which it is lost: 0.8 m, or one radian of turns, or more."""

EXCHANGED_VIEWS = 4
"""Views in a row whose floor matches with the images exchanged, and not as they are, after which they are swapped."""

WALL_MARGIN = 0.2
"""By how much a wall must match worse with the cameras swapped, or with one rotated, to show that they are not."""

PATCH, STEP = 64, 4
"""Columns of a patch of a wall, and the step between rows that are compared."""


class StereoConsistency:
    """Checks whether both images show the floor where it must lie.

    Rows may match by chance, or because a corridor is its own mirror image; the floor of an upside-down camera does not
    match. `rects` are the rectangles of the strips of both cameras.

    Attributes:
        near_wall: at the last comparison both saw one wall in place of the floor, nearer than rows can be matched. It
            matches worse with the cameras swapped; a smooth floor does not.
        seen: comparisons with one floor.
        without: views without one floor since then.
        exchanged: views since then that show one floor with the images exchanged.
    """

    def __init__(self, rig: StereoRig, rects: tuple[Rect, Rect]) -> None:
        self.rig, self.rects = rig, rects
        horizon = rig.center[1] - rig.focal * math.tan(rig.pitch)
        near = rig.focal * rig.camera_height / max(1.0, rects[0].bottom - 1 - horizon)
        self.params = ProximityParams(
            min_floor_correlation=SEEN,
            floor_min_depth_m=0.99 * near,
            floor_max_depth_m=DEPTH_RATIO * near,
            floor_half_width_m=HALF_WIDTH,
            max_tilt_px=SURE_TILT,
        )
        self.tilted = replace(self.params, max_tilt_px=MAX_TILT)
        self.offset = rects[0].left - rects[1].left
        self.size = (rects[0].bottom - rects[0].top, rects[0].right - rects[0].left)
        self.count = self.seen = self.without = self.exchanged = 0
        self.position: Position | None = None
        self.exchanged_at: Position | None = None
        self.near_wall = False

    def warm_up(self) -> None:
        blank = np.zeros(self.size, np.float32)
        floor_correlation(blank, blank, self.rects, self.rig, self.params)

    def reset(self) -> None:
        self.without = self.exchanged = 0

    def compare(self, left: Strips, right: Strips, position: Position) -> bool:
        """Compare one of `EVERY` pairs of images; True when both certainly see one floor."""
        self.count += 1
        ours, theirs = one_color(left.field), one_color(right.field)
        if self.count % EVERY != 1 or ours.shape != self.size or theirs.shape != self.size:
            return False
        self.near_wall = False
        scale = np.float32(1 if ours.dtype.kind == "f" else 255)
        pair = ours.astype(np.float32) / scale, theirs.astype(np.float32) / scale
        correlation = self.correlation(*pair, self.params)
        clear = min(clarity(each) for each in pair) if correlation < SEEN else 1.0
        sure = correlation >= SEEN * clear and clear >= MIN_CLARITY
        if not sure:
            correlation = self.correlation(*pair, self.tilted)
        if sure or correlation >= SEEN:
            rotated = self.correlation(pair[0], pair[1][::-1, ::-1], self.params if sure else self.tilted)
            if rotated > correlation - UPSIDE_DOWN_MARGIN:
                return False  # a smooth wall looks the same upside down
            self.seen, self.without, self.exchanged = self.seen + 1, 0, 0
            return sure
        if is_new_view(position, self.exchanged_at) and self.shows_exchanged_floor(*pair, correlation, clear):
            self.exchanged_at, self.exchanged = position, self.exchanged + 1
        if clear >= CLEAR:
            wall, near = wall_correlation(*pair, self.offset)
            swapped = wall_correlation(*pair[::-1], -self.offset)[0] if wall >= SEEN else 1.0
            self.near_wall = near >= SEEN and swapped <= near - WALL_MARGIN
            upright = (
                swapped <= wall - WALL_MARGIN
                and wall - WALL_MARGIN
                >= wall_correlation(pair[0], np.ascontiguousarray(pair[1][::-1, ::-1]), self.offset)[0]
            )
            if correlation >= LOST * clear or upright:
                self.without = 0
            elif wall < SEEN and is_new_view(position, self.position):
                self.position, self.without = position, self.without + 1
                self.seen = self.seen if self.seen >= BEFORE else 0
        return False

    def shows_exchanged_floor(self, ours: Floats, theirs: Floats, correlation: float, clear: float) -> bool:
        """Whether both images show one floor as those of the other camera, and not as they are."""
        if clear < MIN_CLARITY or correlation >= LOST * clear:
            return False
        found = floor_correlation(theirs, ours, self.rects[::-1], self.rig, self.tilted)
        return found >= max(SEEN * clear, correlation + UPSIDE_DOWN_MARGIN)

    def correlation(self, ours: Floats, theirs: Floats, params: ProximityParams) -> float:
        return floor_correlation(ours, np.ascontiguousarray(theirs), self.rects, self.rig, params)

    @property
    def swapped(self) -> bool:
        return self.exchanged >= EXCHANGED_VIEWS

    @property
    def lost(self) -> bool:
        return self.seen >= BEFORE and self.without >= VIEWS


def clarity(field: Floats) -> float:
    """Correlation of neighbouring pixels in the lower half of a subfield, 0..1: noise has none."""
    rows = field[field.shape[0] // 2 :]
    rows = rows - rows.mean(1, keepdims=True)
    power = float(np.vdot(rows, rows))
    return max(0.0, float(np.vdot(rows[:, 1:], rows[:, :-1])) / power) if power > 0 else 0.0


def wall_correlation(left: Floats, right: Floats, offset: int = 0, reach: int = MAX_DISPARITY) -> tuple[float, float]:
    """Best correlations of a patch of the left subfield, which begins `offset` columns farther to the right, with the
    same rows of the right one: at any disparity, and above `reach` pixels.
    """
    ours, theirs = left[::STEP], right[::STEP]
    rows, wide = ours.shape
    starts, patches = [], []
    for at in range(0, wide - PATCH + 1, PATCH):
        patch = ours[:, at : at + PATCH] - ours[:, at : at + PATCH].mean()
        own = math.sqrt(float(np.vdot(patch, patch)))
        if own > 0.01 * math.sqrt(patch.size):
            starts.append(at)
            patches.append(patch / np.float32(own))
    if not starts:
        return 0.0, 0.0
    columns = np.stack((theirs.sum(0), (theirs**2).sum(0))).astype(np.float64)
    sums = np.cumsum(np.pad(columns, ((0, 0), (1, 0))), 1)
    total, squares = sums[:, PATCH:] - sums[:, :-PATCH]
    size = np.sqrt(np.maximum(squares - total**2 / (rows * PATCH), 1e-6))
    windows = np.lib.stride_tricks.sliding_window_view(theirs, PATCH, 1)
    found = np.matmul(windows, np.stack(patches, -1)).sum(0) / size[:, None]
    away = np.array(starts) + offset - np.arange(len(size))[:, None]
    return float(found[away >= 0].max(initial=0.0)), float(found[away > reach].max(initial=0.0))
