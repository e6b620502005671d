"""The parts of a car that was recorded: what they saw, did and judged then, in place of the world."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ndtorch.errors import InputError
from ndtorch_robot.faults import FaultKind
from ndtorch_robot.ports import Drive, DriveCommand, Placed, SafeCommand, Step, StereoFrames, unseal
from ndtorch_robot.safety import SafeDrive


class RecordedWorld(Drive):
    """Cameras, drive and clock of a loop: each step is the next one of a recording.

    Attributes:
        step: the one that is driven again now; None when the recording is empty.
        last: whether none comes after it.
    """

    def __init__(self, steps: Iterator[Step]) -> None:
        self.steps = steps
        self.step = next(steps, None)
        self.following = next(steps, None)

    @property
    def last(self) -> bool:
        return self.following is None

    @property
    def recorded(self) -> Step:
        assert self.step is not None
        return self.step

    def now(self) -> float:
        return self.recorded.time

    def wait_until(self, time: float) -> None:
        """The next step: time is that of the recording."""
        if self.following is not None:
            self.step, self.following = self.following, next(self.steps, None)

    def read(self) -> StereoFrames:
        if self.recorded.frames is None:
            raise InputError(self.recorded.standing or "the frames of this step were not recorded")
        return self.recorded.frames

    def driven(self) -> DriveCommand:
        return self.recorded.driven

    def take_placed(self) -> Placed:
        return self.recorded.placed

    def send(self, command: SafeCommand) -> DriveCommand:
        """What the drive had made of the command then; nothing moves."""
        unseal(command)
        return self.recorded.sent

    def resume(self) -> bool:
        return True

    def trouble(self) -> str | None:
        return self.recorded.standing

    def telemetry(self) -> dict[str, Any]:
        return dict(self.recorded.telemetry)

    def stop(self) -> None:
        """Nothing moves."""


class RecordedSafety(SafeDrive):
    """The safety layer with the verdicts of then: when frames came is not recorded, nor who pressed a key.

    It lets all commands through, so that they can be compared.
    """

    def __init__(self, world: RecordedWorld) -> None:
        super().__init__(world, world)
        self.world = world

    def see(self, frames: StereoFrames, speed: float, curvature: float = 0.0) -> bool:
        return self.world.recorded.used

    def blind(self, why: str, kind: FaultKind = FaultKind.MISSING) -> None:
        """The recording says by itself why the car stood."""

    def take_interruption(self) -> bool:
        return self.world.recorded.restarted

    def send(self, command: DriveCommand) -> DriveCommand:
        """Stand when the car stood then, and else drive."""
        if self.standing is not None and self.world.recorded.standing is None:
            self.resume()
        return super().send(command)
