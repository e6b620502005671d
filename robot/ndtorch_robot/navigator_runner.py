"""The navigator with its state, and when it restarts, for cars, simulated drives and replays; its map as files."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Body, Command, Grid, Navigator, NavigatorState, Pose, Ranges, StereoRig
from ndtorch.navigation.controllers.ranging._kernels import BLOCKED
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.local_grid import LocalGrid
from ndtorch.navigation.localisation.ndt import to_sparse
from ndtorch.navigation.mapping.map_files import PASSED, save_map
from ndtorch.navigation.options import NavigatorOptions, options_of
from ndtorch_robot.ports import DriveCommand, Placed, Step, StereoFrames

Floats = npt.NDArray[np.float64]

USUAL, LONGEST = Body(), 4.0
"""The car of [A], and the longest step, periods: when frames are missing for longer, the safety layer stops the car."""


class NavigatorRunner:
    """Runs the navigator step by step.

    After a gap in the frames, and after a stop, the temporal filters restart, because they would take the difference
    across the gap for motion. All else is kept: the map, what the controller knows of floor and surroundings, and the
    pose, which is updated while the car rolls out. Where a person has moved the car, the navigator restarts there with
    its map.

    Args:
        rate: steps a second.
        grid: of a map to make, which changes no command.
        near_check: check the space right ahead at the start and after every fault.
    """

    def __init__(
        self,
        options: NavigatorOptions,
        rig: StereoRig,
        rate: float,
        grid: Grid | None = None,
        near_check: bool = True,
        body: Body = USUAL,
    ) -> None:
        self.rig, self.rate, self.body, self.fields = rig, rate, body, options.fields(rig, body)
        self.navigator: Navigator = options.navigator(rig, rate, grid, near_check, None if body == USUAL else body)
        self.state: NavigatorState | None = None
        self.time = -math.inf
        self.rest: Callable[[], NavigatorState] | None = None
        self.options, self.grid, self.near_check = options, grid, near_check
        self.new_goal: tuple[float, float] | None = None

    def configuration(self) -> dict[str, Any]:
        """For a recording: everything from which the same runner can be made again."""
        grid, options = self.grid, asdict(options_of(asdict(self.options)))
        sides = None if grid is None else (grid.left, grid.right, grid.bottom, grid.top, grid.cell)
        about = {"rig": asdict(self.rig), "body": asdict(self.body), "rate_hz": self.rate}
        return about | options | {"map_m": sides, "near_check": self.near_check}

    def drive_to(self, x: float, y: float) -> None:
        """Send the car to a place, m, from the next step on; from any thread."""
        self.new_goal = (x, y)

    def step(
        self, frames: StereoFrames, driven: DriveCommand, placed: Placed = None, anew: bool = False
    ) -> DriveCommand:
        """The command of the navigator, and its state after all that follows it; arguments as of `command`."""
        command = self.command(frames, driven, placed, anew)
        self.complete()
        return command

    def command(
        self, frames: StereoFrames, driven: DriveCommand, placed: Placed = None, anew: bool = False
    ) -> DriveCommand:
        """The command of the navigator as soon as it is known; `complete` has to follow.

        Args:
            driven: motion since the step before.
            placed: where a person has put the car since then.
            anew: the car was stopped, or saw nothing.
        """
        if self.new_goal is not None and self.state is not None:
            goal, self.new_goal = self.new_goal, None
            self.state = self.navigator.on_goal(self.state, goal)
        before, since = self.state, frames.time - self.time
        self.time = frames.time
        lost = anew and before is not None and not self.navigator.controller.can_resume(before.control)
        if before is None or placed is not None or lost:
            if lost:
                self.roll(driven)
            at = self.state.pose if self.state is not None else self.options.start_pose()
            at = at if placed is None else Pose(*map(float, placed))
            command, rest = self.navigator.command_first(*frames[:2], start=at, seen=frames.seen)

            def with_map() -> NavigatorState:
                state, localiser = rest(), self.navigator.localiser
                if before is None:
                    return state
                located = None if localiser is None else before.located
                if located is not None and localiser is not None and placed is not None:
                    located = localiser.reset_pose(located, state.pose)
                return state._replace(map=before.map, located=located)

            self.rest = with_map
        else:
            if anew:
                before = before._replace(fields=None, rows=None)
            # Where frames were lost, the step was longer than the navigator takes it for.
            longer = 1.0 if anew else min(max(1.0, float(round(since * self.rate))), LONGEST)
            moved = Command(torch.tensor([driven.speed * longer]), torch.tensor([driven.curvature]))
            command, self.rest = self.navigator.command_first(*frames[:2], before, moved, seen=frames.seen)
        return DriveCommand(float(command.speed[-1]), float(command.curvature[-1]))

    def complete(self) -> None:
        """Map, localiser, and what the next command needs; nothing where that is done."""
        if self.rest is not None:
            self.state, self.rest = self.rest(), None

    def roll(self, driven: DriveCommand) -> None:
        """Update the pose by a step without usable frames."""
        if self.state is not None and (driven.speed or driven.curvature):
            pose = self.navigator.reckoning.step(self.state.pose, driven.speed, driven.curvature)
            self.state = self.state._replace(pose=pose)

    def trouble(self) -> str | None:
        return None if self.state is None else self.navigator.controller.status_message(self.state.control)

    def map_cells(self) -> torch.Tensor:
        """The map as far as is known now, `[rows, columns]`, its largest cell 1."""
        if self.navigator.grid_map is None:
            raise InputError("this runner makes no map: give it a grid")
        return self.navigator.grid_map.normalised(None if self.state is None else self.state.map)

    def mode(self) -> int:
        assert self.state is not None
        return int(self.navigator.mode(self.state))


APART, RAY = 0.05, np.linspace(0, 1, 80)
"""Metres between two places that are kept, in x and y; ratios of a line of sight."""


class WalkedPath:
    """An observer that keeps the free floor of a map, to `APART`: where the car was as far as it knew, and from its new
    places the lines of sight to what it ranged, which end `PASSED` before it.
    """

    def __init__(self) -> None:
        self.cells: set[tuple[int, int]] = set()

    def __call__(self, step: Step) -> None:
        if step.state is not None:
            x, y, heading = map(float, step.state.place)
            at, ranges = (round(x / APART), round(y / APART)), step.state.ranges
            if at not in self.cells:
                self.cells.add(at)
                valid = np.asarray(ranges.valid).reshape(-1)
                dx, dy = (np.asarray(part, np.float64).reshape(-1)[valid] for part in (ranges.x, ranges.y))
                lengths, angles = np.hypot(dx, dy), np.arctan2(dy, dx) + heading
                along = RAY[:, None] * np.maximum(lengths - PASSED, 0.0)
                lines = np.stack((x + along * np.cos(angles), y + along * np.sin(angles)), -1).reshape(-1, 2)
                self.cells.update(map(tuple, np.rint(lines / APART).astype(int).tolist()))

    def places(self) -> npt.NDArray[np.float64]:
        return np.array(sorted(self.cells), np.float64).reshape(-1, 2) * APART


def save_runner_map(folder: Path, runner: NavigatorRunner, path: WalkedPath, **paths: Floats) -> None:
    """Save the map of a runner with the floor it passed, the localiser's NDT cells, and poses by name."""
    located = None if runner.state is None else runner.state.located
    assert runner.grid is not None
    ndt_cells = None if located is None else to_sparse(located.ndt_map)
    save_map(folder, runner.map_cells(), runner.grid, path.places(), ndt_cells, **paths)


def seen_obstacles(state: NavigatorState, navigator: Navigator) -> Ranges:
    """Places `[n]` of obstacles around a car, in the frame of its body, m: the ranges of the last frame, and the
    blocked cells of the local grid that its controller remembers, if it has one.
    """
    valid = np.asarray(state.ranges.valid).reshape(-1)
    x, y = (np.asarray(part, np.float64).reshape(-1)[valid] for part in (state.ranges.x, state.ranges.y))
    grid = getattr(getattr(state.control, "reactive", state.control), "grid", None)
    if isinstance(grid, LocalGrid) and isinstance(navigator.controller, RangingControl):
        params = navigator.controller.reactive.grid
        evidence = np.maximum(grid.evidence, grid.raised) if grid.raised.size else grid.evidence
        cells, side = np.nonzero(evidence >= BLOCKED), params.cell_m * navigator.unit_m
        dx, dy = ((n + len(evidence) * grid.tag[axis, n] + 0.5) * side for axis, n in enumerate(cells))
        pose = state.pose
        if state.located is not None and navigator.controller.has_goals:
            pose = Pose(*state.located.odometry.tolist())
        dx, dy, heading = dx - float(pose.x), dy - float(pose.y), float(pose.heading)
        cos, sin = math.cos(heading), math.sin(heading)
        x, y = np.concatenate((x, cos * dx + sin * dy)), np.concatenate((y, cos * dy - sin * dx))
    return Ranges(np.hypot(x, y), np.arctan2(y, x), np.zeros_like(x), x, y, np.ones(x.shape, bool))
