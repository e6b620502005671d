"""Kinds of faults. The kind decides what the car does; the message is for people."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class FaultKind(Enum):
    """Kind of a fault.

    Attributes:
        words: description.
        auto_recover: the car drives on by itself once all has been well for long enough. Otherwise a person must
            resume it: a stationary car cannot see whether a frozen image moves again, and what a person or the drive
            has stopped is theirs to start.
    """

    MISSING = "a camera gives no frame", True
    TIMES = "the times of frames do not increase, or lie ahead", True
    AGE = "the frames are old", True
    SLOW = "the cameras give too few frames", True
    SHAPE = "the frames are of a wrong size or type", True
    BLACK = "a camera sees black", True
    BLANK = "a camera shows nothing", True
    UNEQUAL = "the cameras are lit unequally", True
    FROZEN = "a camera gives the same image", False
    SILENCE = "a step took too long", True
    COMMAND = "a command is not finite", False
    DRIVE = "the drive has reported a fault", False
    EMERGENCY = "somebody has stopped the car", False

    def __init__(self, words: str, auto_recover: bool) -> None:
        self.words, self.auto_recover = words, auto_recover


class Fault(NamedTuple):
    """A fault: its kind, and one line for people."""

    kind: FaultKind
    message: str


class Stop(NamedTuple):
    """A stop of the car: its time on the car's clock, s, the reason in one line, and the kind of the fault."""

    time: float
    why: str
    kind: FaultKind
