"""A camera that shows the same picture while the other one's changes: told before the way driven alone could tell."""

from __future__ import annotations

from collections.abc import Sequence

from ndtorch_robot.watching.eye import Eye, SightLimits, change

Seen = tuple[float, float, tuple[Eye, Eye]]
"""Meters driven and radians turned so far, and what both cameras showed there."""

WITNESS = 4.0
"""How many times more than what counts as a change the other camera's picture must have changed, to say of this one,
which has not, that it ought to have: sooner than the way that was driven can say it."""

BARELY = (0.01, 0.015)
"""Meters driven and radians turned from which the other camera is asked."""


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
        before: what they showed, the oldest first.
        here: meters driven and radians turned so far.
    """
    own, other = eyes[k], eyes[1 - k]
    if own.figures.field_spread < 0.5 * other.figures.field_spread:
        return False
    for driven, turned, was in reversed(before):
        if here[0] - driven >= BARELY[0] or abs(here[1] - turned) >= BARELY[1]:
            return (
                unchanged(own, was[k], limits)
                and change(other.field, was[1 - k].field) > WITNESS * limits.field_change
                and change(other.row, was[1 - k].row) > WITNESS * limits.row_change
            )
    return False
