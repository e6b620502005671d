"""The memory of the reactive controller as a picture of the surroundings, and which places were visited."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ndtorch.navigation.local_grid._kernels import Array
from ndtorch.navigation.local_grid.grid import LocalGridParams, cells_at
from ndtorch.navigation.planning.costmap import Bools, LocalMap


def unwrapped(evidence: Array, x: float, y: float, params: LocalGridParams) -> npt.NDArray[np.float32]:
    """Evidence `[size, size]` as rows of y and columns of x around a place, both growing."""
    size, (left, bottom) = params.size, first_cell(x, y, params)
    return np.ascontiguousarray(np.roll(evidence, (-left % size, -bottom % size), (0, 1)).T)


def first_cell(x: float, y: float, params: LocalGridParams) -> tuple[int, int]:
    """Numbers of the cells at the lower left corner of what is remembered around a place."""
    half = params.size // 2
    return math.floor(x / params.cell) - half + 1, math.floor(y / params.cell) - half + 1


def surroundings(
    evidence: Array, x: float, y: float, params: LocalGridParams, blocked: float, known: float
) -> LocalMap:
    """What is around the car.

    Args:
        evidence: `[size, size]` of a `LocalGrid`.
        x, y: the car.
        blocked, known: evidence from which a cell is blocked, and below which it is known to be floor.
    """
    cells = unwrapped(evidence, x, y, params)
    left, bottom = first_cell(x, y, params)
    return LocalMap(cells >= blocked, cells < known, left * params.cell, bottom * params.cell, params.cell)


def disc_cells(radius: float, params: LocalGridParams) -> Array:
    """Places of the body frame that fill a disc, a cell apart, `[2, n]`, m."""
    reach = math.floor(radius / params.cell)
    line = np.arange(-reach, reach + 1, dtype=np.float32) * np.float32(params.cell)
    x, y = np.meshgrid(line, line, indexing="ij")
    inside = x * x + y * y <= radius**2
    return np.stack((x[inside], y[inside]))


def visited_cells(visited: Array, x: float, y: float, params: LocalGridParams, places: LocalGridParams) -> Bools:
    """Which cells were visited, laid out as `surroundings` with these params; `places` are those of the memory."""
    wide = unwrapped(visited, x, y, places) > 0.5
    index = []
    for near, far in zip(first_cell(x, y, params), first_cell(x, y, places), strict=True):
        middle = (np.arange(params.size) + near + 0.5) * params.cell
        index.append(np.clip(np.floor(middle / places.cell).astype(int) - far, 0, places.size - 1))
    columns, rows = index
    return np.ascontiguousarray(wide[np.ix_(rows, columns)])


def passed_around(visited: Array, x: float, y: float, radius: float, params: LocalGridParams) -> Array:
    """The memory of what was visited, with all that lies within a radius of a place, m."""
    passed = visited.copy()
    ahead, left = disc_cells(radius, params)
    passed.reshape(-1)[cells_at((x, y, 0.0), ahead, left, params)] = 1.0
    return passed
