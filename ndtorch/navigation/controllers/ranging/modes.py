"""What the ranging controller does next: its modes and their transitions, as one readable function."""

from __future__ import annotations

from typing import NamedTuple

from ndtorch.navigation.controllers.contract import CRUISE, REVERSE, STOPPED, SUPPRESSED, TURN
from ndtorch.utils.jit import jit


class Facts(NamedTuple):
    """What decides, each true or false.

    Attributes:
        learning: the car has not learned yet what floor looks like.
        blocked_ahead: less is free straight ahead than a turn wants.
        clear: enough is free straight ahead, and the turn has lasted its shortest time.
        blocked_sides: neither arc to the side of the turn leaves enough to drive on.
        reverse_done: reversed as far as intended, or nothing is left behind the car.
        space_ahead: reversed a little, and an arc ahead is long again.
        blocked_rear: nothing is left behind the car either.
    """

    learning: bool
    blocked_ahead: bool
    clear: bool
    blocked_sides: bool
    reverse_done: bool
    space_ahead: bool
    blocked_rear: bool


@jit
def next_mode(mode: int, facts: Facts) -> int:
    """The transitions."""
    f = facts
    if mode == SUPPRESSED and f.learning:
        return SUPPRESSED
    if mode in (SUPPRESSED, CRUISE) and not f.blocked_ahead:
        return CRUISE
    if mode == TURN and f.clear:
        return CRUISE
    if mode == REVERSE and not (f.reverse_done or f.space_ahead):
        return REVERSE
    if f.blocked_sides and mode != REVERSE:
        return STOPPED if f.blocked_rear else REVERSE
    return TURN
