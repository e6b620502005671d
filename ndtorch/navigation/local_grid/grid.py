"""The rolling grid of evidence around a car: what is blocked, what was seen free; and the path that it has driven."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.local_grid._kernels import POSES, DrivenPath, LocalGrid, cell_index, tags
from ndtorch.navigation.proximity.stereo_match import ProximityScan

Floats = npt.NDArray[Any]


@dataclass(frozen=True)
class LocalGridParams:
    """A square of square cells that moves with the car.

    Args:
        cell_m: A cell has sides of this length.
        size_cells: The grid has this many cells along a side, a power of two; it forgets what lies beyond.
        lifetime_s: Evidence falls to 1/e in this time.
        max_evidence: Evidence of an obstacle grows no further than this, so that a few frames can free a cell.
        max_free_evidence: Evidence of free floor grows no further than this, so that four frames can block a cell.

    Raises:
        InputError: A number is out of range.
    """

    cell_m: float = 0.08
    size_cells: int = 64
    lifetime_s: float = 10.0
    max_evidence: float = 5.0
    max_free_evidence: float = 2.0

    def __post_init__(self) -> None:
        check_numbers(self, endless=["lifetime_s"], positive=vars(self))
        if not (self.size_cells >= 2 and self.size_cells & (self.size_cells - 1) == 0):
            raise InputError(f"size_cells must be a power of two, got {self.size_cells}")

    @property
    def reach(self) -> float:
        """Places nearer than this along either axis are inside, m."""
        return (self.size_cells // 2 - 1) * self.cell_m


def empty_grid(x: float, y: float, params: LocalGridParams, raised: bool = False) -> LocalGrid:
    """Nothing is known around a car at x, y, m; what is raised is kept apart, or is not."""
    size = params.size_cells
    above = np.zeros((size, size) if raised else (0, 0), np.float32)
    return LocalGrid(np.zeros((size, size), np.float32), tags.function(float(x), float(y), params.cell_m, size), above)


def empty_path() -> DrivenPath:
    """Of a car that has not driven yet."""
    return DrivenPath(np.zeros((POSES, 3), np.float32), 0)


def mark_obstacles(
    grid: LocalGrid, pose: tuple[float, float, float], x: Floats, y: Floats, weight: float, params: LocalGridParams
) -> LocalGrid:
    """The grid with a range's evidence of raised obstacles in each of the cells that hold places of the body frame.

    What was seen free before there was any measurement that near says nothing.
    """
    if not len(x) or not grid.raised.size:
        return grid
    at = cells_at(pose, x, y, params)
    raised = grid.raised.copy()
    cells = raised.reshape(-1)
    cells[at] = np.minimum(np.maximum(cells[at], 0) + np.float32(weight), np.float32(params.max_evidence))
    return grid._replace(raised=raised)


def mark_stop(
    grid: LocalGrid,
    pose: tuple[float, float, float],
    scan: ProximityScan,
    blocked: float,
    params: LocalGridParams,
) -> LocalGrid:
    """The grid after a proximity check of a standing car.

    Obstacles block at once, and so does a line across the path where no floor is seen; mismatches do not.

    Args:
        blocked: evidence from which a cell blocks.
    """
    evidence, raised = grid.evidence.copy(), grid.raised.copy()
    cells, full = evidence.reshape(-1), np.float32(blocked + 0.1)
    ahead, none = cells_at(pose, *scan.across, params), cells_at(pose, *scan.mismatches, params)
    cells[ahead] = np.minimum(cells[ahead], 0) if scan.floor_seen else np.maximum(cells[ahead], full)
    for layer in (cells, raised.reshape(-1)):
        if layer.size:
            layer[none] = np.minimum(layer[none], 0)
    found = cells_at(pose, *scan.obstacles, params)
    cells[found] = np.maximum(cells[found], full)
    return grid._replace(evidence=evidence, raised=raised)


def cells_at(pose: tuple[float, float, float], x: Floats, y: Floats, params: LocalGridParams) -> npt.NDArray[np.int32]:
    """Numbers of the cells that hold places of the body frame, m."""
    places = (np.ascontiguousarray(part, np.float32) for part in (x, y))
    at: npt.NDArray[np.int32] = cell_index(*places, pose, params.cell_m, params.size_cells)
    return at
