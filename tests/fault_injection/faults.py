"""The injected faults, and how soon the car must have stopped for each."""

from __future__ import annotations

from typing import NamedTuple

STOP_DEADLINE = 0.25
"""Seconds after a fault from which no wheel may turn."""

BLIND_DEADLINE = 0.5
"""The same for images without content, which are judged over several frames."""

DAMAGED_LINK_DEADLINE = 1.0
"""The same for a link of which most frames still arrive intact: the board stops at the fourth damaged frame within a
second. Of 20 000 random starts none took longer than 0.84 s."""

MOUNTING_DEADLINE = 15.0
"""Seconds within which wrongly mounted cameras must be detected; that takes several views while the car drives."""


class Fault(NamedTuple):
    """One fault.

    Attributes:
        part: `"camera"`, `"link"`, `"disk"` or `"load"`.
        name: of the fault, known to the class that injects faults of this part.
        max_reaction_s: seconds after which no wheel may turn; None where the car must drive on.
        only_while_moving: only seconds in which the wheels turn count, because a stale image of a stationary car is
            a correct one.
    """

    part: str
    name: str
    max_reaction_s: float | None
    only_while_moving: bool = False


FAULTS = (
    Fault("camera", "black", STOP_DEADLINE),
    Fault("camera", "frozen", STOP_DEADLINE),
    Fault("camera", "both frozen", STOP_DEADLINE),
    Fault("camera", "no frames", STOP_DEADLINE),
    Fault("camera", "late", STOP_DEADLINE),
    Fault("camera", "white", BLIND_DEADLINE),
    Fault("camera", "grey", BLIND_DEADLINE),
    Fault("camera", "fogged", BLIND_DEADLINE),
    Fault("camera", "covered", BLIND_DEADLINE),
    Fault("camera", "blurred", BLIND_DEADLINE),
    Fault("camera", "frozen but for noise", BLIND_DEADLINE, only_while_moving=True),
    Fault("camera", "noise", BLIND_DEADLINE),
    Fault("camera", "swapped", MOUNTING_DEADLINE),
    Fault("camera", "one upside down", MOUNTING_DEADLINE),
    Fault("camera", "one grey frame", None),
    Fault("camera", "one lost frame", None),
    Fault("link", "cable pulled", STOP_DEADLINE),
    Fault("link", "nothing from the board", STOP_DEADLINE),
    Fault("link", "nothing to the board", STOP_DEADLINE),
    Fault("link", "20 % of bytes to the board damaged", STOP_DEADLINE),
    Fault("link", "20 % of bytes from the board damaged", STOP_DEADLINE),
    Fault("link", "3 % of bytes to the board damaged", DAMAGED_LINK_DEADLINE),
    Fault("link", "3 % of bytes from the board damaged", DAMAGED_LINK_DEADLINE),
    Fault("link", "bytes to the board delayed", STOP_DEADLINE),
    Fault("link", "board restarts", STOP_DEADLINE),
    Fault("link", "single writes lost", None),
    Fault("link", "single bytes damaged", None),
    Fault("disk", "full", None),
    Fault("disk", "slow", None),
    Fault("load", "loop stalls", STOP_DEADLINE),
    Fault("load", "loop stalls shortly", None),
)
"""All faults; a run injects each as often as the others, in random order."""
