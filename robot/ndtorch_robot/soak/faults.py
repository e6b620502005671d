"""The faults of a soak: what goes wrong, and what the car must do then."""

from __future__ import annotations

from typing import NamedTuple

WHEELS = 0.25
"""Seconds after a fault from which no wheel may turn."""

BLIND = 0.5
"""The same for pictures that show nothing: they have to be looked at for a while."""

BAD_LINE = 1.0
"""The same for a line of which most still comes through: what comes is good, and only damage is counted. The board
stops at the fourth damaged frame within a second. How soon there are four is chance: of 20 000 starts none took over
0.84 s."""

TOLD = 15.0
"""Seconds in which cameras that lie the wrong way round must be told: they have to be compared while the car drives."""


class Fault(NamedTuple):
    """One thing that goes wrong.

    Attributes:
        part: `"camera"`, `"link"`, `"disk"` or `"load"`.
        name: what is done.
        within: seconds after which no wheel may turn; None for what the car must drive through.
        rolling: only seconds in which the wheels turn count: of a car that stands, the old picture is a right one, and
            nobody can tell it from a new one.
    """

    part: str
    name: str
    within: float | None
    rolling: bool = False


FAULTS = (
    Fault("camera", "black", WHEELS),
    Fault("camera", "frozen", WHEELS),
    Fault("camera", "both frozen", WHEELS),
    Fault("camera", "no frames", WHEELS),
    Fault("camera", "late", WHEELS),
    Fault("camera", "white", BLIND),
    Fault("camera", "grey", BLIND),
    Fault("camera", "fogged", BLIND),
    Fault("camera", "covered", BLIND),
    Fault("camera", "blurred", BLIND),
    Fault("camera", "frozen but for noise", BLIND, rolling=True),
    Fault("camera", "noise", BLIND),
    Fault("camera", "swapped", TOLD),
    Fault("camera", "one upside down", TOLD),
    Fault("camera", "one bad picture", None),
    Fault("camera", "one lost frame", None),
    Fault("link", "cable pulled", WHEELS),
    Fault("link", "board not heard", WHEELS),
    Fault("link", "board hears nothing", WHEELS),
    Fault("link", "nearly all damaged on the way there", WHEELS),
    Fault("link", "nearly all damaged on the way back", WHEELS),
    Fault("link", "a third damaged on the way there", BAD_LINE),
    Fault("link", "a third damaged on the way back", BAD_LINE),
    Fault("link", "everything late on the way there", WHEELS),
    Fault("link", "board restarts", WHEELS),
    Fault("link", "single writes lost", None),
    Fault("link", "single bytes flipped", None),
    Fault("disk", "full", None),
    Fault("disk", "slow", None),
    Fault("load", "loop stalls", WHEELS),
    Fault("load", "loop stalls shortly", None),
)
"""All of them; within a soak they come in an order of chance, each as often as the others."""
