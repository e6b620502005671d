"""What navigation needs of a robot: a pair of cameras, a drive and a clock."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from torch import Tensor

from ndtorch.navigation import NavigatorState, Strips


class DriveCommand(NamedTuple):
    """What a drive is to do, or what it did: `speed` in m/s, `curvature` in 1/m, positive to the left."""

    speed: float
    curvature: float


class StereoFrames(NamedTuple):
    """What both cameras saw at one time.

    Attributes:
        left, right: `[1, C, H, W]` uint8 or float in 0..1, whole frames or the strips that navigation reads.
        time: when they were taken, seconds on the clock of the loop.
    """

    left: Tensor | Strips
    right: Tensor | Strips
    time: float


class CameraPair(Protocol):
    """Two cameras that are triggered together."""

    def read(self) -> StereoFrames:
        """The newest frames. Raises `InputError` when a camera does not answer."""
        ...

    def close(self) -> None:
        """Give the cameras back."""
        ...


class SafeCommand:
    """A command that the safety layer has let through: the only thing that a drive obeys.

    Nobody but `robot.safety` can make one: the type checker refuses a `DriveCommand` where a drive wants this, and
    at run time both making one without the seal and sending anything else raise `TypeError`.

    Attributes:
        speed, curvature: m/s and 1/m.
        time: when it was let through, on the clock of the loop; a drive in real time refuses an old one.
    """

    __slots__ = ("curvature", "speed", "time")

    def __init__(self, command: DriveCommand, time: float, seal: object) -> None:
        if seal is not _SEAL:
            raise TypeError("only robot.safety may make a SafeCommand: send through a SafeDrive")
        for name, value in zip(self.__slots__, (command.curvature, command.speed, time), strict=True):
            object.__setattr__(self, name, value)

    speed: float
    curvature: float
    time: float

    def __setattr__(self, name: str, value: object) -> None:
        """A command that was let through stays what it is."""
        raise AttributeError(f"a SafeCommand cannot be changed, got {name}={value!r}")


_SEAL = object()


def unseal(command: SafeCommand) -> DriveCommand:
    """What a drive is to do; every drive begins its `send` with this. Raises `TypeError` for anything else."""
    if type(command) is not SafeCommand:
        raise TypeError(f"a drive obeys only a SafeCommand, got {type(command).__name__}: send through a SafeDrive")
    return DriveCommand(command.speed, command.curvature)


class Drive(Protocol):
    """Motors and steering."""

    def send(self, command: SafeCommand) -> DriveCommand:
        """Ask for a speed and a curvature from now on; returns what was really sent, after all limits."""
        ...

    def stop(self) -> None:
        """Stand still as fast as the drive can. May be called at any time, from any thread, and more than once."""
        ...

    def resume(self) -> None:
        """Obey commands again, after the start and after a stop; returns at once. Does nothing when it cannot."""
        ...

    def trouble(self) -> str | None:
        """Why the drive does not obey by itself: in words, or None when all is well."""
        ...


class Odometer(Protocol):
    """What the wheels say about the way driven. A drive without one is believed to do what was sent."""

    def driven(self) -> DriveCommand:
        """Mean speed and curvature since this was last asked."""
        ...


class Clock(Protocol):
    """Time as the loop sees it."""

    def now(self) -> float:
        """Seconds."""
        ...

    def wait_until(self, time: float) -> None:
        """Return at that time, or at once when it is past. A simulated world moves on in here."""
        ...


class LoopStep(Protocol):
    """What a loop tells its observers of a step; `state` is None where the navigator was not asked."""

    @property
    def time(self) -> float: ...
    @property
    def frames(self) -> StereoFrames | None: ...
    @property
    def driven(self) -> DriveCommand: ...
    @property
    def state(self) -> NavigatorState | None: ...
    @property
    def wanted(self) -> DriveCommand: ...
    @property
    def sent(self) -> DriveCommand: ...
    @property
    def standing(self) -> str | None: ...
