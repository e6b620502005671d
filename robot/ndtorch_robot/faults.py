"""Kinds of faults. The kind decides what the car does; the message is for people."""

from __future__ import annotations

from enum import Enum, auto
from typing import NamedTuple


class FaultKind(Enum):
    """Kind of a fault.

    Attributes:
        auto_recover: the car drives on by itself once all has been well for long enough. Otherwise a person must
            resume it: a stationary car cannot see whether a frozen image moves again, and what a person or the drive
            has stopped is theirs to start.
    """

    MISSING = auto()  # a camera gives no frame
    TIMES = auto()  # the times of frames do not increase, or lie ahead
    AGE = auto()  # the frames are old
    SLOW = auto()  # the cameras give too few frames
    SHAPE = auto()  # the frames are of a wrong size or type
    BLACK = auto()  # a camera sees black
    BLANK = auto()  # a camera shows nothing
    UNEQUAL = auto()  # the cameras are lit unequally
    FROZEN = auto()  # a camera gives the same image
    SILENCE = auto()  # a step took too long
    COMMAND = auto()  # a command is not finite
    DRIVE = auto()  # the drive has reported a fault
    EMERGENCY = auto()  # somebody has stopped the car

    @property
    def auto_recover(self) -> bool:
        return self not in (FaultKind.FROZEN, FaultKind.COMMAND, FaultKind.DRIVE, FaultKind.EMERGENCY)


class Fault(NamedTuple):
    """A fault: its kind, one line for people, and when it stopped the car, s on the car's clock."""

    kind: FaultKind
    message: str
    time: float = 0.0
