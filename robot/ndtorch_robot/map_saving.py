"""The map of a car that has driven, as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from ndtorch.navigation.localisation.ndt import to_sparse
from ndtorch.navigation.mapping.map_files import save_map
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import Step

APART = 0.05
"""Metres between two places of the path that are kept, in x and y."""


class WalkedPath:
    """An observer that keeps where the car was as far as it knew, to `APART`, for the free floor of a map."""

    def __init__(self) -> None:
        self.cells: set[tuple[int, int]] = set()

    def __call__(self, step: Step) -> None:
        if step.state is not None:
            x, y, _ = step.state.place
            self.cells.add((round(float(x) / APART), round(float(y) / APART)))

    def places(self) -> npt.NDArray[np.float64]:
        """The places, m, `[T, 2]`."""
        return np.array(sorted(self.cells), np.float64).reshape(-1, 2) * APART


def runner_ndt_cells(runner: NavigatorRunner) -> npt.NDArray[np.float32] | None:
    """The localiser's NDT cells as map files hold them; None without a localiser."""
    if runner.state is None or runner.state.located is None:
        return None
    return to_sparse(runner.state.located.ndt_map)


def save_runner_map(folder: Path, runner: NavigatorRunner, path: WalkedPath) -> None:
    """Write the map of a runner that makes one."""
    grid = runner.grid
    assert grid is not None
    save_map(folder, runner.map_cells(), grid, path.places(), runner_ndt_cells(runner))
