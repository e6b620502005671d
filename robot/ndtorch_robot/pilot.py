"""Who steers: the navigator, and when it begins anew. The same for a car, a simulated drive and a replay."""

from __future__ import annotations

from typing import Any

import torch

from ndtorch.navigation import Command, Grid, Navigator, NavigatorState, Pose, StereoRig
from ndtorch.navigation.localisation import LocaliserState
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.navigating import configuration
from ndtorch_robot.ports import DriveCommand, Placed, StereoFrames


class Pilot:
    """The navigator with its state.

    What was seen before a gap cannot be compared with what is seen after it: motion across it would be believed. So
    the navigator begins anew after one, and also after the car stood, since a car that stands sees nothing move,
    which the navigator takes for being lost. It keeps the map then, and where it believes to be; where somebody has
    carried the car, it is told the place.

    Args:
        options: of the navigator.
        rig: the cameras.
        rate: steps a second.
        grid: of a map to make, which changes no command.

    Attributes:
        navigator: what steers.
        rig, fields: the cameras, and the rectangles that are looked at in each.
        state: of the navigator after the last step.
    """

    def __init__(self, options: NavigatorOptions, rig: StereoRig, rate: float, grid: Grid | None = None) -> None:
        self.rig, self.rate, self.fields = rig, rate, options.fields(rig)
        self.navigator: Navigator = options.navigator(rig, rate, grid)
        self.state: NavigatorState | None = None
        self.options, self.grid = options, grid

    def configuration(self) -> dict[str, Any]:
        """For a recording: everything from which the same pilot can be made again."""
        half = 0.0 if self.grid is None else self.grid.right
        return configuration(self.options, self.rig, self.rate) | {"map_half_size_m": half}

    def warm_up(self) -> None:
        """Have the navigator's kernels compiled or loaded."""
        self.navigator.warm_up()

    def step(
        self, frames: StereoFrames, driven: DriveCommand, placed: Placed = None, anew: bool = False
    ) -> DriveCommand:
        """What the navigator wants.

        Args:
            frames: what is seen now.
            driven: what the car did since the step before.
            placed: where somebody has put the car since then.
            anew: the car stood, or saw nothing, since then.
        """
        before = self.state
        if before is None or anew or placed is not None:
            at = before.pose if before is not None else None
            if placed is not None:
                at = Pose(*(torch.tensor(float(value)) for value in placed))
            command, state = self.navigator(frames.left, frames.right, start=at)
            if before is not None:
                state = state._replace(map=before.map, located=self.located(before, state, placed))
        else:
            moved = Command(*(torch.tensor([value]) for value in driven))
            command, state = self.navigator(frames.left, frames.right, before, moved)
        self.state = state
        return DriveCommand(float(command.speed[-1]), float(command.curvature[-1]))

    def located(self, before: NavigatorState, state: NavigatorState, placed: Placed) -> LocaliserState | None:
        """What the localiser knows after the navigator has begun anew: all that it knew, and where it was put."""
        if before.located is None or self.navigator.localiser is None:
            return None
        return before.located if placed is None else self.navigator.localiser.put(before.located, state.pose)

    def mode(self) -> int:
        """What the controller is doing, as it numbers it."""
        assert self.state is not None
        return int(self.navigator.mode(self.state))
