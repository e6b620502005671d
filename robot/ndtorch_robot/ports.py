"""Interfaces of the loop: camera pair, drive, clock and observers, and the record of a step."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import InitVar, dataclass
from enum import Enum, auto
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

if TYPE_CHECKING:
    from torch import Tensor

    from ndtorch.navigation import NavigatorState, Strips

Placed = tuple[float, float, float] | None
"""x, y, m, and heading, radians, to which a person has moved the car; None where nobody has."""

Report = Callable[[str], None]
"""Called with one line for each event."""


def print_note(line: str) -> None:
    """Tell the user, beside the results."""
    logging.getLogger(__name__).info(line)


class DriveCommand(NamedTuple):
    """What a drive is to do, or what it did: `speed` in m/s, `curvature` in 1/m, positive to the left."""

    speed: float
    curvature: float


STAND = DriveCommand(0.0, 0.0)


class StereoFrames(NamedTuple):
    """What both cameras saw at one time, s on the clock of the loop.

    Frames are `[1, C, H, W]` uint8 or float in 0..1, or the strips of them that navigation reads. Of a recording,
    `seen` is what the controller steered by, where the subfields were not kept.
    """

    left: Tensor | Strips
    right: Tensor | Strips
    time: float
    seen: Any = None


class FaultKind(Enum):
    """Kind of a fault."""

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
        """Whether the car drives on by itself once all has been well for long enough.

        Otherwise a person must resume it: a stationary car cannot see whether a frozen image moves again, and what a
        person or the drive has stopped is theirs to start.
        """
        return self not in (FaultKind.FROZEN, FaultKind.COMMAND, FaultKind.DRIVE, FaultKind.EMERGENCY)


class Fault(NamedTuple):
    """A fault: its kind, one line for people, and when it stopped the car, s on the car's clock."""

    kind: FaultKind
    message: str
    time: float = 0.0


class CameraPair(Protocol):
    """Two cameras that are triggered together."""

    def read(self) -> StereoFrames:
        """The newest frames. Raises `InputError` when a camera does not answer."""
        ...

    def close(self) -> None: ...


_SEAL = object()


@dataclass(frozen=True)
class SafeCommand:
    """A command that has passed the safety layer; drives obey nothing else.

    Only `ndtorch_robot.safety` can make one: the type checker refuses a `DriveCommand` in its place, and at run time
    both making one without the seal and sending anything else raise `TypeError`. `time`, at which it passed, is on the
    clock of the loop; a drive in real time refuses an old one.
    """

    command: DriveCommand
    time: float
    seal: InitVar[object]

    def __post_init__(self, seal: object) -> None:
        if seal is not _SEAL:
            raise TypeError("only robot.safety may make a SafeCommand: send through a SafeDrive")


def unseal(command: SafeCommand) -> DriveCommand:
    """The command; every drive begins its `send` with this. Raises `TypeError` for anything else."""
    if type(command) is not SafeCommand:
        raise TypeError(f"a drive obeys only a SafeCommand, got {type(command).__name__}: send through a SafeDrive")
    return command.command


class Drive(Protocol):
    """Motors and steering. A class that inherits from this one needs only the four methods without a body."""

    def send(self, command: SafeCommand) -> DriveCommand:
        """Ask for a speed and a curvature from now on; returns what was really sent, after all limits."""
        ...

    def stop(self) -> None:
        """Stop as fast as the drive can; at any time, from any thread, also repeatedly."""
        ...

    def resume(self) -> bool:
        """Obey commands again, after the start and after a stop; returns at once. False when it cannot now."""
        ...

    def driven(self) -> DriveCommand:
        """Mean speed and curvature since the last call, as measured, or as commanded."""
        ...

    def take_placed(self) -> Placed:
        """The place to which the car was moved by hand since the last call; None where it was not."""
        return None

    def trouble(self) -> str | None:
        """Why the drive does not obey, in words; None when all is well."""
        return None

    def telemetry(self) -> dict[str, Any]:
        """State of the drive for JSON, with units in the keys: `battery_v`, `faults`, `armed` and the like."""
        return {}

    def cameras_and_clock(self) -> tuple[CameraPair, Clock] | None:
        """The cameras in the simulated world that this drive moves, and the clock of a loop in it; None for a car."""
        return None

    def round_trips(self) -> Sequence[float]:
        """Response times of the link, s, the newest last."""
        return ()

    def close(self) -> None:
        """Stop, and give everything back. Calling it again does nothing."""
        self.stop()


class Closing:
    """What is closed at the end of a `with`."""

    def close(self) -> None: ...

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class Clock(Protocol):
    """Time as the loop sees it."""

    def now(self) -> float: ...

    def wait_until(self, time: float) -> None:
        """Return at that time, or at once when it is past. A simulated world moves on in here."""
        ...


class Step(NamedTuple):
    """One step of the loop, for observers; a recording keeps all but `state`."""

    number: int
    time: float  # s on the clock of the loop
    frames: StereoFrames | None  # None when the cameras gave none
    driven: DriveCommand  # motion since the step before
    wanted: DriveCommand  # by the navigator
    sent: DriveCommand  # by the safety layer to the drive
    state: NavigatorState | None = None  # of the navigator after the step; None when it was not asked
    standing: str | None = None  # the reason for which the car is stopped
    used: bool = True  # whether the navigator processed the frames
    restarted: bool = False  # the navigator was restarted, after it had seen nothing, or no motion
    placed: Placed = None  # where the car was moved before this step, where the navigator was restarted
    telemetry: Mapping[str, Any] = MappingProxyType({})


Observer = Callable[[Step], None]
"""Recordings, views and scores: called after every step. An exception ends the drive, the car stopped."""
