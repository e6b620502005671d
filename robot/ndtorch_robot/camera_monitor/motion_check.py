"""Checks of one camera against the motion of the car: a frozen image, and an image that turns the wrong way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ndtorch_robot.camera_monitor._kernels import BLOCK
from ndtorch_robot.camera_monitor.image_quality import Floats, Snapshot, change
from ndtorch_robot.camera_monitor.limits import CameraLimits

MIN_RATIO = 2.5
"""Multiple of the limit of change by which the other camera's floor must have changed, to conclude that this camera,
which has not, should have."""

MIN_MOTION = (0.004, 0.005)
"""Metres driven and radians turned from which the other camera is consulted. Of 5852 pairs of images of good cameras
farther apart than this, 26 in the dark had hardly changed, and the other camera of none of them had changed enough."""

MAX_TURN = 0.3
"""Largest turn between two images, radians: beyond it their overlap is too small."""

SOFT = 1.0
"""Levels added to the standard deviation of what is compared, so that noise is no pattern."""

RESIDUAL = 0.05
"""Added to what a correlation leaves to 1: noise and block size leave this much of matching images."""

MEMORY = 0.85
"""Weight of earlier comparisons after another one."""


class View(NamedTuple):
    """What the left and the right camera showed after so many metres driven and radians turned."""

    driven: float
    turned: float
    images: tuple[Snapshot, Snapshot]


def is_unchanged(now: Snapshot, before: Snapshot, limits: CameraLimits) -> bool:
    return (
        change(now.field, before.field) < limits.field_change_levels
        and change(now.row, before.row) < limits.row_change_levels
    )


def is_frozen(
    images: tuple[Snapshot, Snapshot], k: int, history: Sequence[View], here: tuple[float, float], limits: CameraLimits
) -> bool:
    """Whether camera `k` shows the same as before a small motion of the car, while the other one shows much else: with
    at least half of the other's contrast it must have changed too. `here`: metres driven and radians turned so far.
    """
    own, other = images[k], images[1 - k]
    if own.statistics.field_contrast < 0.5 * other.statistics.field_contrast:
        return False
    for driven, turned, was in reversed(history):
        if here[0] - driven >= MIN_MOTION[0] or abs(here[1] - turned) >= MIN_MOTION[1]:
            if not is_unchanged(own, was[k], limits):
                return False
            if change(other.field, was[1 - k].field) > MIN_RATIO * limits.field_change_levels:
                return True
    return False


class FlowDirectionCheck:
    """Compares images of one camera before and after a turn, shifted as the wheels say and the other way.

    A place that is nearly its own mirror image, such as a corridor, hides an upside-down camera from a comparison of
    both cameras. The direction in which the image moves during a turn shows it. `focal` is in pixels.
    """

    def __init__(self, focal: float, limits: CameraLimits) -> None:
        self.focal, self.limits = focal, limits
        self.reset()

    def reset(self) -> None:
        self.count = self.reversed_sum = 0.0

    def compare(self, now: Snapshot, before: Snapshot, turned: float) -> bool:
        """Compare two images, between which the car turned so many radians to the left; True for an upside-down camera.

        Only the middle half is used: towards the sides the image moves outward while the car drives, whichever way it
        turns.
        """
        shift, edge = self.focal * turned / BLOCK, len(now.row) // 4
        rows = now.row[edge:-edge], before.row[edge:-edge]
        forward, backward = (shifted_correlation(*rows, sign * shift) for sign in (1, -1))
        self.count = MEMORY * self.count + 1
        ratio = float(np.log((1 + RESIDUAL - forward) / (1 + RESIDUAL - backward)))
        self.reversed_sum = MEMORY * self.reversed_sum + ratio
        return self.decided(self.reversed_sum)

    @property
    def upright(self) -> bool:
        """Whether the image turns as the wheels say, as clearly as it must turn the other way to be upside down."""
        return self.decided(-self.reversed_sum)

    def decided(self, total: float) -> bool:
        """Whether a sum of log ratios is clear after enough turns."""
        return self.count >= self.limits.min_turns and total > self.limits.reversed_log_ratio * self.count


def shifted_correlation(now: Floats, before: Floats, shift: float) -> float:
    """Best correlation of two rows, the later one shifted to the right by 0.5 to 1.5 times `shift`, blocks."""
    low, high = sorted((round(0.5 * shift), round(1.5 * shift)))
    best = -1.0
    for by in range(low, high + 1):
        a, b = (now[by:], before[: len(before) - by]) if by >= 0 else (now[:by], before[-by:])
        a, b = a - a.mean(), b - b.mean()
        size = (float(a @ a) ** 0.5 + SOFT * len(a) ** 0.5) * (float(b @ b) ** 0.5 + SOFT * len(b) ** 0.5)
        best = max(best, float(a @ b) / size)
    return best
