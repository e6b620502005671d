"""Do both cameras see the same thing, the right way round?"""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.glance import BLOCK
from ndtorch.kernels.partners import partners as partners_kernel
from ndtorch_robot.watching.eye import Eye, Floats, SightLimits, compiled

PATCH = 20
"""Blocks of a patch that is looked for in the other row: 80 pixels."""

FLAT = 0.02
"""Standard deviation, as a share of the mean, below which a patch shows nothing to look for."""

SOFT = 0.3
"""Levels that are added to the standard deviation of what a patch is compared with."""

REACH = 240
"""Largest disparity, pixels: that of a wall .54 m ahead. What is nearer has no partner, and fits by chance."""

MIRRORED = 160
"""How far apart patches may lie that fit when mirrored, pixels. Both sides of a corridor do, further apart."""

MOVED, TURNED = 0.04, 0.05
"""Way, m, and turn, radians, from which a view is another one."""

EVERY = 3
"""Frames of which one is compared: it costs as much as all else."""


SYMMETRIC = 3
"""Patches without which a view does not say that a row is mirrored: one or two may be of a thing that is its own mirror
image, as an edge or a door is, and stay in view for metres."""

AT_ONCE = 1.0
"""Most that one view says of a mirrored row: right before a wall nothing has a partner, and much fits by chance."""


FITS = 0.6
"""Correlation from which a patch has a partner: one that has none, on neither side, says nothing. Right before a wall
none has, and chance fits better where it may do so more often."""


class Agreement:
    """Looks for patches of the left row in the right one, where they may be and where they may not.

    What parallel cameras see lies further to the right in the left row. Where partners lie on the other side, the
    cameras are swapped, both are upside down, or one looks outward; where they fit when mirrored, one is upside down.
    How much better they fit there is summed up, less what chance may do, and never below 0 (the cumulative sum test of
    Page, Biometrika 41, 1954): the sum of good cameras falls back to 0, that of wrong ones grows as the car drives.

    Args:
        limits: see `SightLimits`.
        reach: largest disparity, pixels.
    """

    def __init__(self, limits: SightLimits, reach: int = REACH) -> None:
        self.limits, self.reach = limits, reach // BLOCK
        self.seen = 0
        self.forget()

    def forget(self) -> None:
        """Nothing was compared yet: somebody may have turned the cameras round."""
        self.swapped = self.mirrored = 0.0
        self.view: tuple[float, float] | None = None

    def compare(
        self,
        left: Eye,
        right: Eye,
        view: tuple[float, float] | None = None,
        upright: bool = False,
        sure: bool = False,
        wall: bool = False,
    ) -> str | None:
        """Look at two rows; returns what is wrong with them, in words.

        Args:
            view: way and turn of the car so far, m and rad. One view is looked at once: it does not become likelier by
                being seen again. By default the view is another one every time.
            upright: both pictures turn as the wheels say. Then none is upside down, and what fits when mirrored is a
                place that is nearly its own mirror image.
            sure: both pictures show one floor. Then the cameras lie as they should, and nothing else counts.
            wall: both show one wall, too near for partners to be found. Then nothing is learned from the rows.
        """
        if upright:
            self.mirrored = 0.0
        self.seen += 1
        if self.seen % EVERY == 1 and len(right.row) > PATCH + self.reach and is_new(view, self.view) and not wall:
            self.view = view
            self.add(partners(left.row, right.row, self.reach, self.limits))
        if sure:
            self.swapped = self.mirrored = 0.0
        if self.mirrored > self.limits.mirrored:
            return "one of the cameras is upside down: the rows fit when one is mirrored"
        if self.swapped > self.limits.swapped:
            return "the cameras are swapped, upside down or turned: things lie on the wrong side of each other"
        return None

    def add(self, found: tuple[Floats, Floats, Floats]) -> None:
        """Take in the correlations of patches: as they should lie, on the wrong side, mirrored."""
        right, wrong, mirrored = found
        chance = self.limits.by_chance * len(right)
        fits = np.maximum(right, wrong) >= FITS
        self.swapped = max(0.0, self.swapped + float((wrong - right - self.limits.by_chance)[fits].sum()))
        if len(right) >= SYMMETRIC:
            more = min(float((mirrored - np.maximum(right, wrong)).sum()) - chance, AT_ONCE)
            self.mirrored = max(0.0, self.mirrored + more)


def is_new(view: tuple[float, float] | None, before: tuple[float, float] | None) -> bool:
    """Whether a view is another one than that before: the way and the turn of the car so far, m and rad."""
    if view is None or before is None:
        return True
    way, turn = abs(view[0] - before[0]), abs(view[1] - before[1])
    return way >= MOVED or turn >= TURNED


def partners(
    left: Floats, right: Floats, reach: int, limits: SightLimits, mirrored: int = MIRRORED // BLOCK
) -> tuple[Floats, Floats, Floats]:
    """Best correlations of the patches of a left row of block means, for those that show something.

    Returns:
        With a partner up to `reach` blocks to the left, to the right, and up to `mirrored` blocks away when mirrored.
    """
    if not compiled():
        return partners_slowly(left, right, reach, limits, mirrored)
    found = np.empty((3, len(left) // (PATCH // 2)), np.float32)
    shown = partners_kernel(left, right, PATCH, reach, mirrored, limits.row_contrast, FLAT, SOFT, found)
    return found[0, :shown], found[1, :shown], found[2, :shown]


def partners_slowly(
    left: Floats, right: Floats, reach: int, limits: SightLimits, mirrored: int = MIRRORED // BLOCK
) -> tuple[Floats, Floats, Floats]:
    """The same without Numba."""
    windows = np.lib.stride_tricks.sliding_window_view(right, PATCH)
    theirs = windows - windows.mean(1, keepdims=True)
    theirs /= np.sqrt(np.einsum("ij,ij->i", theirs, theirs))[:, None] + SOFT * PATCH**0.5
    starts = np.arange(0, len(left) - PATCH + 1, PATCH // 2)
    ours = left[starts[:, None] + np.arange(PATCH)]
    ours = ours - ours.mean(1, keepdims=True)
    size = np.sqrt(np.einsum("ij,ij->i", ours, ours))
    shown = size > PATCH**0.5 * max(limits.row_contrast, FLAT * float(left.mean()))
    # Both sides must be as likely by chance: only patches from where both reach as far.
    shown &= (starts >= reach // 2) & (starts < len(windows) - reach // 2)
    ours, starts = ours[shown] / size[shown, None], starts[shown]
    scores, turned = ours @ theirs.T, ours[:, ::-1] @ theirs.T
    away = starts[:, None] - np.arange(len(windows))
    low = np.float32(-1)
    return (
        np.where((away >= 1) & (away <= reach), scores, low).max(1, initial=-1),
        np.where((away <= -2) & (away >= -reach), scores, low).max(1, initial=-1),
        np.where(abs(away) <= mirrored, turned, low).max(1, initial=-1),
    )
