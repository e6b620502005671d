"""Driving a recording again: the same loop on the same input must want the same."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from ndtorch.errors import InputError
from ndtorch.navigation import Body, Grid, StereoRig
from ndtorch.navigation.options import options_of
from ndtorch_robot.car import Car
from ndtorch_robot.faults import FaultKind
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Drive, DriveCommand, Observer, Placed, Report, SafeCommand, Step, StereoFrames, unseal
from ndtorch_robot.recording.reading import Recording
from ndtorch_robot.safety import SafeDrive

MAP_HALF = 10.0
"""Metres from the start to the sides of the map of a car that made none."""


def make_runner(configuration: dict[str, Any], mapping: bool = False) -> NavigatorRunner:
    """The runner of a recording.

    Args:
        mapping: make a map as well, as large as the car's own, or `MAP_HALF` to all sides where it made none.

    Raises:
        InputError: a configuration of something else than a navigator, or with unusable values.
    """
    try:
        options, rig = options_of(configuration), StereoRig(**configuration["rig"])
        sides = configuration["map_m"] or (-MAP_HALF, MAP_HALF, -MAP_HALF, MAP_HALF)
        grid = Grid(*map(float, sides)) if mapping else None
        rate, near, body = configuration["rate_hz"], configuration["near_check"], Body(**configuration.get("body", {}))
        return NavigatorRunner(options, rig, float(rate), grid, bool(near), body)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"the recording's configuration cannot be used: {type(error).__name__} {error}") from None


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

    def see(self, frames: StereoFrames, speed: float) -> bool:
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


@dataclass
class Comparison:
    """How a replay compares with what was recorded.

    Attributes:
        steps: replayed.
        same: of them, with the same command to the bit.
        first_different: number of the first other one.
        speed_difference, curvature_difference: largest, m/s and 1/m.
        skipped: steps recorded without frames.
    """

    steps: int = 0
    same: int = 0
    first_different: int | None = None
    speed_difference: float = 0.0
    curvature_difference: float = 0.0
    skipped: int = 0

    def add(self, number: int, old: DriveCommand, new: DriveCommand) -> None:
        self.steps += 1
        if old == new:
            self.same += 1
            return
        if self.first_different is None:
            self.first_different = number
        self.speed_difference = max(self.speed_difference, abs(old.speed - new.speed))
        self.curvature_difference = max(self.curvature_difference, abs(old.curvature - new.curvature))


class Compare:
    """An observer that compares what is wanted now with what was wanted then."""

    def __init__(self, world: RecordedWorld, report: Report | None = None) -> None:
        self.world, self.report, self.result = world, report, Comparison()

    def __call__(self, step: Step) -> None:
        recorded = self.world.recorded
        if step.used:
            before = self.result.first_different
            self.result.add(recorded.number, recorded.wanted, step.wanted)
            if self.report is not None and before is None and self.result.first_different is not None:
                self.report(f"step {recorded.number}: the replay wants something else than was recorded")
        elif recorded.used:
            self.result.skipped += 1


def replay(
    recording: Recording, runner: NavigatorRunner, observers: Iterable[Observer] = (), report: Report | None = None
) -> Comparison:
    """Run a runner on a recording.

    Args:
        observers: told every step as it is made now; `wanted` is of now, `sent` and `standing` are of then.
        report: told when the car stood and went on, and of the first command that differs.
    """
    world = RecordedWorld(recording.steps())
    compare, safe = Compare(world, report), RecordedSafety(world)
    safe.report = report or safe.report
    if world.step is None:
        return compare.result
    car = Car(runner, world, safe, observers=[compare, *observers])
    car.observers.append(lambda step: car.ended.set() if world.last else None)
    car.run(warm_up=False)
    return compare.result
