"""What navigation needs of a robot: a pair of cameras, a drive and a clock."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from torch import Tensor

from ndtorch.navigation import Strips


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


class Drive(Protocol):
    """Motors and steering."""

    def send(self, command: DriveCommand) -> DriveCommand:
        """Ask for a speed and a curvature from now on; returns what was really sent, after all limits."""
        ...

    def stop(self) -> None:
        """Stand still as fast as the drive can. May be called at any time, and more than once."""
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
