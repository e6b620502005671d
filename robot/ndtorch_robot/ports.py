"""What the loop needs of a robot: a pair of cameras, a drive and a clock; and what it tells of every step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

from torch import Tensor

from ndtorch.navigation import NavigatorState, Strips

Placed = tuple[float, float, float] | None
"""x, y, m, and heading, radians, at which somebody has put the car; None where nobody has."""

Report = Callable[[str], None]
"""Told of whatever happens, one line each."""


class DriveCommand(NamedTuple):
    """What a drive is to do, or what it did: `speed` in m/s, `curvature` in 1/m, positive to the left."""

    speed: float
    curvature: float


STAND = DriveCommand(0.0, 0.0)


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
    """Motors and steering: all that the loop needs of whatever moves the car.

    A class that inherits from this one needs only the four methods without a body; the others answer for a drive
    that knows nothing more of itself.
    """

    def send(self, command: SafeCommand) -> DriveCommand:
        """Ask for a speed and a curvature from now on; returns what was really sent, after all limits."""
        ...

    def stop(self) -> None:
        """Stand still as fast as the drive can. May be called at any time, from any thread, and more than once."""
        ...

    def resume(self) -> bool:
        """Obey commands again, after the start and after a stop; returns at once. False when it cannot now."""
        ...

    def driven(self) -> DriveCommand:
        """Mean speed and curvature since this was last asked, as the wheels say or as they were told."""
        ...

    def take_placed(self) -> Placed:
        """Where somebody has put the car since this was last asked; None for a car that only drives."""
        return None

    def trouble(self) -> str | None:
        """Why the drive does not obey by itself: in words, or None when all is well."""
        return None

    def telemetry(self) -> dict[str, Any]:
        """What the drive says of itself, for JSON, units in the keys: `battery_v`, `faults`, `armed` and the like."""
        return {}

    def round_trips(self) -> Sequence[float]:
        """How long the line took to answer, s, the newest last."""
        return ()

    def close(self) -> None:
        """Stop, and give everything back. Calling it again does nothing."""
        self.stop()


class Clock(Protocol):
    """Time as the loop sees it."""

    def now(self) -> float:
        """Seconds."""
        ...

    def wait_until(self, time: float) -> None:
        """Return at that time, or at once when it is past. A simulated world moves on in here."""
        ...


class Step(NamedTuple):
    """What one step of the loop saw and did, for observers; a recording keeps it, and gives it back without `state`.

    Attributes:
        number, time: of the step; seconds on the clock of the loop.
        frames: what was seen; None when the cameras gave nothing.
        driven: what the drive did since the step before.
        wanted, sent: by the navigator, and by the safety layer to the drive.
        state: of the navigator after the step; None when it was not asked.
        standing: why the car is kept standing, or None.
        used: whether the navigator was asked.
        restarted: the navigator began anew, because it had seen nothing, or nothing move, before.
        placed: where somebody had put the car before this step, so that the navigator began anew there.
        telemetry: what the drive says of itself.
    """

    number: int
    time: float
    frames: StereoFrames | None
    driven: DriveCommand
    wanted: DriveCommand
    sent: DriveCommand
    state: NavigatorState | None = None
    standing: str | None = None
    used: bool = True
    restarted: bool = False
    placed: Placed = None
    telemetry: Mapping[str, Any] = MappingProxyType({})


class Observer(Protocol):
    """Whatever watches the loop: recordings, views, records, scores. It is told every step after it was made.

    What it raises ends the drive, with the car stopped.
    """

    def __call__(self, step: Step, /) -> None: ...
