"""Do both cameras still see one floor? Then they lie as they lay; what fits by chance or by symmetry is outvoted."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ndtorch.navigation import Strips
from ndtorch.navigation.near_floor import floor_likeness
from ndtorch.navigation.near_params import NearParams
from ndtorch.navigation.rig import Rect, StereoRig
from ndtorch_robot.watching.agreement import EVERY, REACH, is_new
from ndtorch_robot.watching.eye import Floats, compiled, one_color

SEEN = 0.7
"""Likeness from which both cameras see one floor, beyond doubt."""

LEAST = 0.5
"""In the dark noise leaves less of it: then `SEEN` of what it leaves is enough, where it leaves so much. At a quarter
of the light .99 of 462 looks of good cameras had that, and with one of them turned round none."""

EITHER = 0.3
"""How much less alike both must be with one of them turned round."""

LOST = 0.5
"""Likeness below which they do not, as a share of what their noise leaves of it."""

CLEAR = 0.6
"""Correlation of neighbouring pixels of the floor below which it is noise, or too fine, and says nothing."""

DEEP = 1.3
"""The nearest floor is looked at: up to so many times the depth of its nearest row."""

BESIDE = 0.3
"""How far to either side of the car's middle, m."""

SURE, TILT = 8, 26
"""Rows by which the horizon may lie higher or lower where both see one floor for sure, and at all: a bump, or a camera
that is turned by a degree and a half; and cameras that look up or down by three."""

BEFORE = 6
"""Looks in a row that must have seen one floor before it can be lost."""

VIEWS = 20
"""Views in a row without one floor after which it is lost: 0.8 m of way, or a radian of turns, or more."""

WORSE = 0.2
"""How much worse a wall must fit with the cameras swapped, or with one turned round, to say that they are not."""

PATCH, STEP = 64, 4
"""Columns of what is looked for where there is a wall, and rows between two that are compared."""


class OneFloor:
    """Looks whether the floor lies in both pictures where it must: the best proof that cameras lie as they should.

    Two rows are alike by chance, or because a corridor is its own mirror image. Floors are not: of one camera that is
    upside down next to nothing fits.

    Args:
        rig: the camera pair.
        rects: where the strips of both cameras lie.

    Attributes:
        wall: at the last look both saw one wall where the floor should be, so near that nothing at the horizon has its
            partner where rows are compared, and it fits worse with them swapped: a smooth floor does not.
    """

    def __init__(self, rig: StereoRig, rects: tuple[Rect, Rect]) -> None:
        self.rig, self.rects = rig, rects
        horizon = (rig.height - 1) / 2 - rig.focal * math.tan(rig.pitch)
        near = rig.focal * rig.camera_height / max(1.0, rects[0].bottom - 1 - horizon)
        self.params = NearParams(
            floor=SEEN, floor_from=0.99 * near, floor_to=DEEP * near, floor_beside=BESIDE, tilt=SURE
        )
        self.tilted = replace(self.params, tilt=TILT)
        self.apart = rects[0].left - rects[1].left
        self.size = (rects[0].bottom - rects[0].top, rects[0].right - rects[0].left)
        self.asked = self.seen = self.without = 0
        self.view: tuple[float, float] | None = None
        self.wall = False

    def warm_up(self) -> None:
        """Have the kernel compiled or loaded."""
        blank = np.zeros(self.size, np.float32)
        floor_likeness(blank, blank, self.rects, self.rig, self.params, compiled())

    def forget(self) -> None:
        """Somebody may have turned the cameras round."""
        self.without = 0

    def compare(self, left: Strips, right: Strips, view: tuple[float, float]) -> bool:
        """Look at two pictures, now and then; True when both see one floor for sure.

        Args:
            view: way and turn of the car so far, m and rad.
        """
        self.asked += 1
        ours, theirs = one_color(left.field), one_color(right.field)
        if self.asked % EVERY != 1 or ours.shape != self.size or theirs.shape != self.size:
            return False
        self.wall = False
        scale = np.float32(1 if ours.dtype.kind == "f" else 255)
        pair = ours.astype(np.float32) / scale, theirs.astype(np.float32) / scale
        likeness = self.like(*pair, self.params)
        clear = min(clearness(each) for each in pair) if likeness < SEEN else 1.0
        sure = likeness >= SEEN * clear and clear >= LEAST
        if not sure:
            likeness = self.like(*pair, self.tilted)
        if sure or likeness >= SEEN:
            turned = self.like(pair[0], pair[1][::-1, ::-1], self.params if sure else self.tilted)
            if turned > likeness - EITHER:
                return False  # a smooth wall, of which nobody can say which way it is up
            self.seen, self.without = self.seen + 1, 0
            return sure
        if clear >= CLEAR:
            wall, near = wall_likeness(*pair, self.apart)
            swapped = wall_likeness(*pair[::-1], -self.apart)[0] if wall >= SEEN else 1.0
            self.wall = near >= SEEN and swapped <= near - WORSE
            if likeness >= LOST * clear or (swapped <= wall - WORSE and self.one_way_up(*pair, wall)):
                self.without = 0
            elif wall < SEEN and is_new(view, self.view):
                self.view, self.without = view, self.without + 1
                self.seen = self.seen if self.seen >= BEFORE else 0
        return False

    def like(self, ours: Floats, theirs: Floats, params: NearParams) -> float:
        """How alike the floor in both pictures is, where it must lie."""
        return floor_likeness(ours, np.ascontiguousarray(theirs), self.rects, self.rig, params, compiled())

    def one_way_up(self, ours: Floats, theirs: Floats, wall: float) -> bool:
        """Whether the wall that both see fits worse with one of them turned round."""
        turned, _ = wall_likeness(ours, np.ascontiguousarray(theirs[::-1, ::-1]), self.apart)
        return turned <= wall - WORSE

    @property
    def lost(self) -> bool:
        """Both have seen one floor, and do not any more."""
        return self.seen >= BEFORE and self.without >= VIEWS


def clearness(field: Floats) -> float:
    """Correlation of neighbouring pixels in the lower half of a subfield, 0..1: noise has none."""
    rows = field[field.shape[0] // 2 :]
    rows = rows - rows.mean(1, keepdims=True)
    power = float(np.vdot(rows, rows))
    return max(0.0, float(np.vdot(rows[:, 1:], rows[:, :-1])) / power) if power > 0 else 0.0


def wall_likeness(left: Floats, right: Floats, apart: int = 0, reach: int = REACH) -> tuple[float, float]:
    """Best correlation of a patch of the left subfield in the same rows of the right one, farther to the left.

    Args:
        apart: columns by which the left subfield begins farther to the right.
        reach: pixels.

    Returns:
        Anywhere there, and where it lies farther away than `reach`.
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
    away = np.array(starts) + apart - np.arange(len(size))[:, None]
    return float(found[away >= 0].max(initial=0.0)), float(found[away > reach].max(initial=0.0))
