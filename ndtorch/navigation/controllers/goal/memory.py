"""The memory of the reactive controller as a picture of the surroundings, and which places were visited."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from torch import Tensor

from ndtorch.navigation.controllers.ranging.patch import PatchParams, cell_numbers
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.planning.costmap import Bools, LocalMap


def unwrapped(evidence: Tensor, x: float, y: float, params: PatchParams) -> npt.NDArray[np.float32]:
    """Evidence `[size * size]` as rows of y and columns of x around a place, both growing."""
    size, (left, bottom) = params.size, first_cell(x, y, params)
    grid = evidence.numpy().reshape(size, size)
    return np.ascontiguousarray(np.roll(grid, (-left % size, -bottom % size), (0, 1)).T)


def first_cell(x: float, y: float, params: PatchParams) -> tuple[int, int]:
    """Numbers of the cells at the lower left corner of what is remembered around a place."""
    half = params.size // 2
    return math.floor(x / params.cell) - half + 1, math.floor(y / params.cell) - half + 1


def surroundings(evidence: Tensor, x: float, y: float, params: PatchParams, blocked: float, known: float) -> LocalMap:
    """What is around the car.

    Args:
        evidence: `[size * size]` of a `Patch`.
        x, y: the car.
        blocked, known: evidence from which a cell is blocked, and below which it is known to be floor.
    """
    cells = unwrapped(evidence, x, y, params)
    left, bottom = first_cell(x, y, params)
    return LocalMap(cells >= blocked, cells < known, left * params.cell, bottom * params.cell, params.cell)


def disc_cells(radius: float, params: PatchParams) -> Tensor:
    """Places of the body frame that fill a disc, a cell apart, `[2, n]`, m."""
    import torch

    reach = math.floor(radius / params.cell)
    line = torch.arange(-reach, reach + 1, dtype=torch.get_default_dtype()) * params.cell
    x, y = torch.meshgrid(line, line, indexing="ij")
    inside = x.square() + y.square() <= radius**2
    return torch.stack((x[inside], y[inside]))


def visited_cells(visited: Tensor, x: float, y: float, params: PatchParams, places: PatchParams) -> Bools:
    """Which cells were visited, laid out as `surroundings` with these params; `places` are those of the memory."""
    wide = unwrapped(visited, x, y, places) > 0.5
    index = []
    for near, far in zip(first_cell(x, y, params), first_cell(x, y, places), strict=True):
        middle = (np.arange(params.size) + near + 0.5) * params.cell
        index.append(np.clip(np.floor(middle / places.cell).astype(int) - far, 0, places.size - 1))
    columns, rows = index
    return np.ascontiguousarray(wide[np.ix_(rows, columns)])


def passed_around(visited: Tensor, x: float, y: float, radius: float, params: PatchParams) -> Tensor:
    """The memory of what was visited, with all that lies within a radius of a place, m."""
    blank = visited.new_zeros(())
    number = cell_numbers(disc_cells(radius, params).to(visited), Pose(blank + x, blank + y, blank), params)
    return visited.index_fill(-1, number, 1.0)
