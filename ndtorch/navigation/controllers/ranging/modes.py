"""What the ranging controller does next: its states and their transitions, as one readable function."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.navigation.controllers.contract import CRUISE, REVERSE, STOPPED, SUPPRESSED, TURN

MODES = 5


class Facts(NamedTuple):
    """What decides, each true or false.

    Attributes:
        learning: the car has not learned yet what floor looks like.
        near: less is free straight ahead than a turn wants.
        clear: enough is free straight ahead, and the turn has lasted its shortest time.
        hemmed: neither arc to the side of the turn leaves enough to drive on.
        backed: reversed as far as intended, or nothing is left behind the car.
        room: reversed a little, and an arc ahead is long again.
        cornered: nothing is left behind the car either.
    """

    learning: bool
    near: bool
    clear: bool
    hemmed: bool
    backed: bool
    room: bool
    cornered: bool


def next_mode(mode: int, facts: Facts) -> int:
    """The transitions."""
    f = facts
    if mode == SUPPRESSED and f.learning:
        return SUPPRESSED
    if mode in (SUPPRESSED, CRUISE) and not f.near:
        return CRUISE
    if mode == TURN and f.clear:
        return CRUISE
    if mode == REVERSE and not (f.backed or f.room):
        return REVERSE
    if f.hemmed and mode != REVERSE:
        return STOPPED if f.cornered else REVERSE
    return TURN


def transition_table() -> Tensor:
    """`next_mode` for all modes and facts, `[MODES * 2^7]`: a look-up serves whole batches.

    The number of an entry is `mode * 2^7` plus 1, 2, 4, ... for the facts in their order.
    """
    count = len(Facts._fields)
    flags = itertools.product((False, True), repeat=count)
    facts = [Facts(*reversed(values)) for values in flags]
    return torch.tensor([next_mode(mode, f) for mode in range(MODES) for f in facts])
