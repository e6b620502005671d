"""The map of a car that has driven, as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from ndtorch.navigation import NavigatorState
from ndtorch.navigation.localisation.ndt import to_sparse
from ndtorch.navigation.localisation.pose_graph import compose_poses
from ndtorch.navigation.localisation.state import frame_pose, lasting_frame, map_frames
from ndtorch.navigation.mapping.map_files import save_map
from ndtorch.navigation.mapping.range_log import FramePose
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Step

APART = 0.05
"""Metres between two places of the path that are kept, in x and y."""


class WalkedPath:
    """An observer that keeps where the car believes that it was, for the free floor of a map: to `APART` in the frames
    of a localiser, which move, and so as often as there are places, however far the car drives.

    Attributes:
        frame: number of the present one; None where there is no localiser, or it was lost.
        places: in whole `APART` by frame.
    """

    def __init__(self) -> None:
        self.frame: float | None = None
        self.places: dict[float | None, set[tuple[int, int]]] = {None: set()}

    def __call__(self, step: Step) -> None:
        if step.state is None:
            return
        located = step.state.located
        at = None if located is None else frame_pose(located)
        frame, (x, y, *_) = (None, step.state.place) if at is None else at
        if frame != self.frame and self.frame is not None and located is not None:
            self.keep(self.frame, lasting_frame(located, self.frame))
        self.frame = frame
        self.places.setdefault(frame, set()).add((round(float(x) / APART), round(float(y) / APART)))

    def keep(self, frame: float, home: FramePose | None) -> None:
        """Move the places of a frame that has ended to the one that lasts."""
        if home is None or home.frame != frame:
            ended = self.places.pop(frame, set())
            if home is not None and ended:
                there = np.rint(in_frame(np.array(home.pose), ended) / APART).astype(int).tolist()
                self.places.setdefault(home.frame, set()).update(map(tuple, there))

    def moved(self, state: NavigatorState | None) -> npt.NDArray[np.float64]:
        """The places `[T, 2]` as far as they are known by now, in which the map has moved with them."""
        where: dict[float | None, npt.NDArray[np.float64]] = {None: np.zeros(3)}
        if state is not None and state.located is not None:
            now = map_frames(state.located)
            where |= dict(zip(now.numbers.tolist(), now.poses.numpy(), strict=True))
        found = [in_frame(where[n], places) for n, places in self.places.items() if n in where and places]
        return np.concatenate([np.zeros((0, 2)), *found])


def in_frame(base: npt.NDArray[np.float64], places: set[tuple[int, int]]) -> npt.NDArray[np.float64]:
    """Places of a frame in the world, m, `[T, 2]`."""
    here = np.array(sorted(places), np.float64) * APART
    return compose_poses(base, np.concatenate((here, np.zeros((len(here), 1))), -1))[:, :2]


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
