"""Does a picture turn as the wheels say? That of a camera that is upside down turns the other way."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.glance import BLOCK
from ndtorch_robot.watching.eye import Eye, Floats, SightLimits

SOFT = 1.0
"""Levels that are added to the standard deviation of what is compared: noise must not look like a pattern."""

FINE = 0.05
"""Added to what a correlation leaves to one: noise and the width of a block leave so much of a picture that fits."""

MOST = 0.3
"""Largest turn between two pictures, radians: beyond it too little is seen in both."""

KEEP = 0.85
"""Share of what was found before that is left after another comparison."""


class Turning:
    """Compares pictures of one camera from before and after a turn, shifted as they must be and the other way.

    A place that is its own mirror image, as a corridor nearly is, hides a camera that is upside down from whoever
    compares both cameras. It cannot hide which way the picture goes while the car turns.

    Args:
        focal: of the camera, pixels.
        limits: see `SightLimits`.
    """

    def __init__(self, focal: float, limits: SightLimits) -> None:
        self.focal, self.limits = focal, limits
        self.forget()

    def forget(self) -> None:
        """Nothing was compared yet."""
        self.count = self.backwards = 0.0

    def compare(self, now: Eye, before: Eye, turned: float) -> bool:
        """Look at two pictures between which the car has turned so far, radians to the left; whether it is wrong.

        Only at their middles: what lies beside a car goes to the side while it drives, whichever way it turns.
        """
        shift, edge = self.focal * turned / BLOCK, len(now.row) // 4
        rows = now.row[edge:-edge], before.row[edge:-edge]
        with_it, against_it = (fit(*rows, sign * shift) for sign in (1, -1))
        self.count = KEEP * self.count + 1
        self.backwards = KEEP * self.backwards + float(np.log((1 + FINE - with_it) / (1 + FINE - against_it)))
        return self.enough and self.backwards > self.limits.backwards * self.count

    @property
    def enough(self) -> bool:
        """Whether there were turns to judge by."""
        return self.count >= self.limits.turns

    @property
    def upright(self) -> bool:
        """Whether its picture turns as the wheels say, by as much as it must turn the other way to be wrong."""
        return self.enough and self.backwards < -self.limits.backwards * self.count


def fit(now: Floats, before: Floats, shift: float) -> float:
    """Best correlation of two rows, the later one shifted to the right by half to one and a half of this, blocks."""
    low, high = sorted((round(0.5 * shift), round(1.5 * shift)))
    best = -1.0
    for by in range(low, high + 1):
        a, b = (now[by:], before[: len(before) - by]) if by >= 0 else (now[:by], before[-by:])
        a, b = a - a.mean(), b - b.mean()
        size = (float(a @ a) ** 0.5 + SOFT * len(a) ** 0.5) * (float(b @ b) ** 0.5 + SOFT * len(b) ** 0.5)
        best = max(best, float(a @ b) / size)
    return best
