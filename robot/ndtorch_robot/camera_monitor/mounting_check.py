"""Do the rows of both cameras match as those of a correctly mounted stereo pair?"""

from __future__ import annotations

import numpy as np

from ndtorch_robot.camera_monitor._kernels import BLOCK, best_correlations
from ndtorch_robot.camera_monitor.image_quality import Floats, Snapshot
from ndtorch_robot.camera_monitor.limits import CameraLimits

PATCH = 20
"""Blocks of a patch that is searched in the other row: 80 pixels."""

FLAT = 0.02
"""Standard deviation of a patch, as a ratio to the mean of the row, below which it has no texture."""

SOFT = 0.3
"""Levels added to the standard deviation of the right patch."""

MAX_DISPARITY = 240
"""Largest disparity, pixels: a wall 0.54 m ahead. What is nearer has no match, and correlates by chance."""

MAX_MIRRORED_DISPARITY = 160
"""Largest distance of mirrored matches, pixels. The two sides of a corridor match when mirrored, farther apart."""

NEW_VIEW = (0.04, 0.05)
"""Metres driven and radians turned from which a view is a new one."""

EVERY = 3
"""One of this many frames is compared, which costs as much as all other checks."""

MIN_PATCHES = 3
"""Patches without which a view does not show a mirrored row: one or two may belong to an object that is its own mirror
image, such as a door, which stays in view for metres."""

MAX_PER_VIEW = 1.0
"""Largest contribution of one view to the sum of mirrored matches: right before a wall much matches by chance."""

MIN_CORRELATION = 0.6
"""Correlation from which a patch has a match; patches without one contribute nothing."""

Position = tuple[float, float]
"""Metres driven and radians turned so far."""


class MountingCheck:
    """Searches patches of the left row in the right one, where a correct pair has them and where it has not.

    With parallel cameras matches lie further to the left in the right row. Where they lie on the other side, the
    cameras are swapped, both are upside down, or one points outward; where they match when mirrored, one is upside
    down. By how much the wrong match is better is accumulated, less what chance explains, and never below 0 (the
    cumulative sum test of Page, Biometrika 41, 1954): the sum of good cameras falls back to 0, that of wrong ones grows
    as the car drives. `reach` is the largest disparity, pixels.
    """

    def __init__(self, limits: CameraLimits, reach: int = MAX_DISPARITY) -> None:
        self.limits, self.reach = limits, reach // BLOCK
        self.count = 0
        self.reset()

    def reset(self) -> None:
        self.swapped = self.mirrored = 0.0
        self.position: Position | None = None

    def compare(
        self,
        left: Snapshot,
        right: Snapshot,
        position: Position | None = None,
        *,
        upright: bool = False,
        same_floor: bool = False,
        near_wall: bool = False,
    ) -> str | None:
        """Compare two rows; returns what is wrong with the cameras, in words.

        Args:
            position: each view counts once; by default every call has a new one.
            upright: both images turn as the wheels say, so that mirrored matches come from the scene.
            same_floor: both images show one floor, so that the cameras are mounted correctly whatever else matches.
            near_wall: both show a wall too near for matches, so that the rows say nothing.
        """
        if upright:
            self.mirrored = 0.0
        self.count += 1
        due = self.count % EVERY == 1 and len(right.row) > PATCH + self.reach
        if due and is_new_view(position, self.position) and not near_wall:
            self.position = position
            self.add(correlations(left.row, right.row, self.reach, self.limits))
        if same_floor:
            self.swapped = self.mirrored = 0.0
        if self.mirrored > self.limits.mirrored_sum:
            return "one of the cameras is upside down: the rows match when one is mirrored"
        if self.swapped > self.limits.swapped_sum:
            return "the cameras are swapped, upside down or turned: matches lie on the wrong side"
        return None

    def add(self, found: tuple[Floats, Floats, Floats]) -> None:
        """Add the correlations of patches: on the right side, on the wrong side, mirrored."""
        right, wrong, mirrored = found
        chance = self.limits.chance_correlation
        fits = np.maximum(right, wrong) >= MIN_CORRELATION
        self.swapped = max(0.0, self.swapped + float((wrong - right - chance)[fits].sum()))
        if len(right) >= MIN_PATCHES:
            more = float((mirrored - np.maximum(right, wrong)).sum()) - chance * len(right)
            self.mirrored = max(0.0, self.mirrored + min(more, MAX_PER_VIEW))


def is_new_view(position: Position | None, before: Position | None) -> bool:
    if position is None or before is None:
        return True
    return abs(position[0] - before[0]) >= NEW_VIEW[0] or abs(position[1] - before[1]) >= NEW_VIEW[1]


def correlations(
    left: Floats, right: Floats, reach: int, limits: CameraLimits, mirrored: int = MAX_MIRRORED_DISPARITY // BLOCK
) -> tuple[Floats, Floats, Floats]:
    """Best correlations of those patches of a left row of block means that have texture, with a match up to `reach`
    blocks to the left, to the right, and up to `mirrored` blocks away when mirrored.
    """
    found = np.empty((3, len(left) // (PATCH // 2)), np.float32)
    count = best_correlations(left, right, PATCH, reach, mirrored, limits.row_contrast_levels, FLAT, SOFT, found)
    return found[0, :count], found[1, :count], found[2, :count]
