"""Kinds of faults. What a car does about a fault hangs on its kind; the words are for people."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from ndtorch.errors import InputError


class Kind(Enum):
    """What sort of fault it is.

    Attributes:
        passes: the car drives on by itself when all has been well for long enough. Otherwise somebody must say so:
            a picture that stands still cannot be seen to move again by a car that stands, cameras that are swapped do
            not change back, and what a person or the drive has stopped is theirs to start.
    """

    MISSING = "a camera gives no frame", True
    TIMES = "the times of frames do not increase, or lie ahead", True
    AGE = "the frames are old", True
    SLOW = "the cameras give too few frames", True
    SHAPE = "the frames are of a wrong size or kind", True
    BLACK = "a camera sees black", True
    BLANK = "a camera shows nothing", True
    NOISE = "a camera shows noise", True
    BLURRED = "a camera is blurred", True
    FROZEN = "a camera gives the same picture", False
    CARRIED = "the pictures move although the wheels stand", True
    MOUNTING = "the cameras are swapped, upside down or turned", False
    SILENCE = "a step took too long", True
    LIMITS = "a command is out of limits", True
    COMMAND = "a command is not finite", False
    DRIVE = "the drive has said so", False
    NOT_TOLD = "nobody has said go", False
    EMERGENCY = "somebody has stopped the car", False

    def __init__(self, words: str, passes: bool) -> None:
        self.words, self.passes = words, passes


class Wrong(NamedTuple):
    """What is wrong with frames: its kind, and one line for people."""

    kind: Kind
    words: str


class SightError(InputError):
    """Frames cannot be trusted.

    Attributes:
        kind: of the fault.
    """

    def __init__(self, kind: Kind, words: str) -> None:
        super().__init__(words)
        self.kind = kind


class Stop(NamedTuple):
    """A car was stopped: when, on its clock, why, in one line, and what kind of fault it was."""

    time: float
    why: str
    kind: Kind
