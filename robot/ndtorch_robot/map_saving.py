"""The map of a car that has driven, as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from ndtorch.navigation import NavigatorState
from ndtorch.navigation.localisation.ndt import to_sparse
from ndtorch.navigation.localisation.pose_graph import compose_poses
from ndtorch.navigation.localisation.state import frame_pose, map_frames
from ndtorch.navigation.mapping.map_files import save_map
from ndtorch.navigation.mapping.range_log import FramePose
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Step

APART = 0.05
"""Metres between two places of the path that are kept."""


class WalkedPath:
    """An observer that keeps where the car believes that it was, for the free floor of a map.

    Attributes:
        places: x, y, m, as it was believed on the way.
        frames: the same in frames that are moved; None where there is no localiser, or it was lost.
    """

    def __init__(self) -> None:
        self.places: list[tuple[float, float]] = []
        self.frames: list[FramePose | None] = []

    def __call__(self, step: Step) -> None:
        if step.state is None:
            return
        x, y = float(step.state.place.x), float(step.state.place.y)
        if not self.places or np.hypot(x - self.places[-1][0], y - self.places[-1][1]) >= APART:
            self.places.append((x, y))
            located = step.state.located
            self.frames.append(None if located is None else frame_pose(located))

    def moved(self, state: NavigatorState | None) -> npt.NDArray[np.float64]:
        """The path `[T, 2]` as far as it is known by now, in which the map has moved with the path."""
        path = np.array(self.places, np.float64).reshape(-1, 2)
        if state is not None and state.located is not None:
            now = map_frames(state.located)
            where = dict(zip(now.numbers.tolist(), now.poses.numpy(), strict=True))
            for k, at in enumerate(self.frames):
                if at is not None and at.frame in where:
                    path[k] = compose_poses(where[at.frame], np.array(at.pose))[:2]
        return path


def runner_ndt_cells(runner: NavigatorRunner) -> npt.NDArray[np.float32] | None:
    """The localiser's NDT cells as map files hold them; None without a localiser."""
    if runner.state is None or runner.state.located is None:
        return None
    return to_sparse(runner.state.located.ndt_map)


def save_runner_map(folder: Path, runner: NavigatorRunner, path: WalkedPath) -> None:
    """Write the map of a runner that makes one."""
    grid = runner.grid
    assert grid is not None
    cells = runner.map_cells()
    save_map(folder, cells, grid, path.moved(runner.state), runner_ndt_cells(runner))
