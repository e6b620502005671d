"""A camera that shows the same picture while the other one's changes: told before the way driven alone could tell."""

from __future__ import annotations

from collections.abc import Sequence

from ndtorch_robot.watching.eye import Eye, SightLimits, change

Seen = tuple[float, float, tuple[Eye, Eye]]
"""Meters driven and radians turned so far, and what both cameras showed there."""

WITNESS = 2.5
"""How many times more than what counts as a change the other camera's floor must have changed, to say of this one,
which has not, that it ought to have: sooner than the way that was driven can say it."""

BARELY = (0.004, 0.005)
"""Meters driven and radians turned from which the other camera is asked. Of 5852 pairs of pictures of good cameras
farther apart, up to 1.2 times the way on which every picture must change, 26 in the dark had hardly changed, and none
of them had a witness."""

KEPT_WAYS = 8
"""Pictures of the moving car that are kept to compare with, however long it then stands."""

SLOWLY = 0.3
"""Speed, m/s, below which every picture of a moving car is kept, not one of two: a car that comes to stand shows few
that were taken while it moved."""


def unchanged(now: Eye, before: Eye, limits: SightLimits) -> bool:
    """Nothing but noise is different."""
    return change(now.field, before.field) < limits.field_change and change(now.row, before.row) < limits.row_change


def left_behind(
    eyes: tuple[Eye, Eye], k: int, before: Sequence[Seen], here: tuple[float, float], limits: SightLimits
) -> bool:
    """Whether a camera shows the same as before the car moved a little, where the other one shows much else.

    Both look at one floor: where this one sees half as much of it, it must see it move too.

    Args:
        eyes: what both show now.
        k: the one that is asked about.
        before: what they showed while the car moved, the oldest first.
        here: meters driven and radians turned so far.
    """
    own, other = eyes[k], eyes[1 - k]
    if own.figures.field_spread < 0.5 * other.figures.field_spread:
        return False
    for driven, turned, was in reversed(before):
        if here[0] - driven >= BARELY[0] or abs(here[1] - turned) >= BARELY[1]:
            if not unchanged(own, was[k], limits):
                return False
            if change(other.field, was[1 - k].field) > WITNESS * limits.field_change:
                return True
    return False
