"""Driving a recording again: the same program on the same input must want the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Command, Grid, GridMap, NavigatorState, Rect, StereoRig
from ndtorch.navigation.options import AnyNavigator, NavigatorOptions, options_of
from ndtorch_robot.navigating import say
from ndtorch_robot.ports import DriveCommand, StereoFrames
from ndtorch_robot.recording.reading import RecordedStep, Recording

Placed = tuple[float, float, float] | None

MAP_HALF = 10.0
"""Metres from the start to the sides of the map of a car that made none."""


class Pilot(Protocol):
    """Whatever made the commands."""

    @property
    def navigator(self) -> AnyNavigator:
        """What steers."""
        ...

    @property
    def rig(self) -> StereoRig:
        """The cameras."""
        ...

    @property
    def fields(self) -> tuple[Rect, Rect]:
        """The rectangles that it looks at."""
        ...

    @property
    def state(self) -> NavigatorState | None:
        """Of the navigator after the last step."""
        ...

    def step(
        self, frames: StereoFrames, driven: DriveCommand, placed: Placed = None, restarted: bool = False
    ) -> DriveCommand:
        """The command for a step; `restarted` where the navigator began anew."""
        ...


class NavigatorPilot:
    """The navigator alone: replays recordings whose configuration is those of `configuration`.

    Args:
        grid: to map as well, which changes no command.
    """

    def __init__(self, rig: StereoRig, rate: float, options: NavigatorOptions, grid: Grid | None = None) -> None:
        self.rig, self.fields = rig, options.fields(rig)
        self.navigator = options.navigator(rig, rate, GridMap(rig, grid) if grid is not None else None, say)
        self.state: NavigatorState | None = None

    def step(
        self, frames: StereoFrames, driven: DriveCommand, placed: Placed = None, restarted: bool = False
    ) -> DriveCommand:
        """The command for a step; the navigator begins anew where the car was carried or had been blind."""
        before = self.state
        if placed is not None or restarted or before is None:
            command, state = self.navigator(frames.left, frames.right)
            if restarted and before is not None:  # it knows where it is all the same
                state = state._replace(pose=before.pose, map=before.map)
            self.state = state
        else:
            moved = Command(*(torch.tensor([value]) for value in driven))
            command, self.state = self.navigator(frames.left, frames.right, before, moved)
        return DriveCommand(float(command.speed[-1]), float(command.curvature[-1]))


def make_pilot(configuration: dict[str, Any], mapping: bool = False) -> Pilot:
    """The pilot of a recording.

    Args:
        mapping: make a map as well, as large as the car's own, or `MAP_HALF` to all sides where it made none.

    Raises:
        InputError: a configuration of a program that is not known, or with unusable values.
    """
    program = configuration.get("program")
    try:
        if program == "navigator":
            rig = StereoRig(**configuration["rig"])
            half = float(configuration.get("map_half_size_m", 0.0)) or MAP_HALF
            grid = Grid(-half, half, -half, half) if mapping else None
            return NavigatorPilot(rig, float(configuration["rate_hz"]), options_of(configuration), grid)
        if program == "drive":
            from ndtorch_robot.recording.drive_pilot import DrivePilot

            return DrivePilot(configuration)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"the recording's configuration cannot be used: {type(error).__name__} {error}") from None
    raise InputError(f"the recording was made by {program!r}, which cannot be replayed; known are navigator and drive")


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
        """One step."""
        self.steps += 1
        if old == new:
            self.same += 1
            return
        if self.first_different is None:
            self.first_different = number
        self.speed_difference = max(self.speed_difference, abs(old.speed - new.speed))
        self.curvature_difference = max(self.curvature_difference, abs(old.curvature - new.curvature))


def replay(
    recording: Recording, pilot: Pilot, seen: Callable[[RecordedStep, DriveCommand | None], None] | None = None
) -> Comparison:
    """Run a pilot on a recording.

    Args:
        seen: called with each step and the new command, which is None where the pilot was not asked.
    """
    result = Comparison()
    with torch.inference_mode():
        for step in recording.steps():
            if step.frames is None or not step.used:
                result.skipped += step.used
                if seen is not None:
                    seen(step, None)
                continue
            command = pilot.step(step.frames, step.driven, step.placed, step.restarted)
            result.add(step.number, step.command, command)
            if seen is not None:
                seen(step, command)
    return result
