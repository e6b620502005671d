"""The map as a grid: the certainties of all ranged features, summed where the car saw them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.navigation.certainty import REACH, BeamTable, beam_table, sample_certainty
from ndtorch.navigation.odometry import Pose, to_world
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import StereoRig


@dataclass(frozen=True)
class Grid:
    """A rectangle of the world divided into square cells.

    Args:
        left, right: the x of its sides, m; bottom, top: the y of them.
        cell: side of a cell, m; [A] uses 1 cm.

    Raises:
        InputError: an empty rectangle, or one of more than 2^31 cells.
    """

    left: float = -10.0
    right: float = 10.0
    bottom: float = -10.0
    top: float = 10.0
    cell: float = 0.01

    def __post_init__(self) -> None:
        if not (self.left < self.right and self.bottom < self.top and self.cell > 0):
            raise InputError(f"expected left < right, bottom < top and cell > 0, got {self}")
        if not self.rows * self.columns < 2**31:
            raise InputError(f"{self} has {self.rows} x {self.columns} cells, which is too many")

    @property
    def rows(self) -> int:
        """Number of cells along y."""
        return math.ceil(round((self.top - self.bottom) / self.cell, 6))

    @property
    def columns(self) -> int:
        """Number of cells along x."""
        return math.ceil(round((self.right - self.left) / self.cell, 6))

    def empty(self, batch: tuple[int, ...], like: Tensor) -> Tensor:
        """Zeros `[*batch, rows + 2, columns + 2]`: the cells and a margin that collects what lies outside."""
        return like.new_zeros(*batch, self.rows + 2, self.columns + 2)

    def inner(self, cells: Tensor) -> Tensor:
        """The cells without their margin, a view `[..., rows, columns]`."""
        return cells.narrow(-2, 1, self.rows).narrow(-1, 1, self.columns)

    def find(self, x: Tensor, y: Tensor) -> Tensor:
        """Number of the cell that holds each point, counted along the rows with their margin."""
        # Truncation is a floor here: the cells begin at 1, and what is below falls into the margin, 0.
        scale = 1 / self.cell
        column = ((x - (self.left - self.cell)) * scale).clamp(0, self.columns + 1).to(torch.int64)
        row = ((y - (self.bottom - self.cell)) * scale).clamp(0, self.rows + 1).to(torch.int64)
        return row.mul_(self.columns + 2).add_(column)

    def centre(self, row: Tensor, column: Tensor) -> tuple[Tensor, Tensor]:
        """x and y of the middle of a cell, m."""
        return self.left + (column + 0.5) * self.cell, self.bottom + (row + 0.5) * self.cell


class GridMapState(NamedTuple):
    """State of `GridMap`: summed certainty `[..., rows + 2, columns + 2]`, the outermost ones a margin."""

    cells: Tensor


class GridMap(nn.Module):
    """Allocentric map of [A §2.3]: the sum of the beam products placed at the dead-reckoned poses.

    The value of a cell is the mean of `certainty` over its area, summed over all observations; only cells
    near the beams are touched. `normalise` divides by the largest, which the paper does once at the end.

    Called as `map, state = grid_map(ranges, pose, state)`; row 0 of `map` is at the smallest y.
    **The cells are changed in place**, because copying 4 million of them takes longer than all else together:
    keep a `clone()` of a state that is to be used again. What is seen outside the grid is ignored.

    Shapes:
        ranges `[..., T, n]`, pose `[..., T]` -> cells `[..., rows, columns]`. `state=None` starts empty.

    Args:
        rig: the camera pair.
        grid: the part of the world to map.
        reach: space constant R_b of the beams, m.
        farthest: range up to which places along a beam are at most half a cell apart, m.

    Raises:
        InputError: ranges and poses that do not belong together, or cells of another size.
    """

    tangent: Tensor
    weight: Tensor

    def __init__(self, rig: StereoRig, grid: Grid | None = None, reach: float = REACH, farthest: float = 2.2) -> None:
        super().__init__()
        if not reach > 0:
            raise InputError(f"reach must be > 0 m, got {reach}")
        self.rig, self.grid, self.reach = rig, grid or Grid(), reach
        table = beam_table(rig, farthest, self.grid.cell / 2)
        self.register_buffer("tangent", table.tangent, persistent=False)
        self.register_buffer("weight", table.weight, persistent=False)

    def forward(self, ranges: Ranges, pose: Pose, state: GridMapState | None = None) -> tuple[Tensor, GridMapState]:
        batch = check_observations(ranges, pose)
        cells = self.grid.empty(batch, ranges.x) if state is None else state.cells
        if cells.shape != (*batch, self.grid.rows + 2, self.grid.columns + 2):
            raise InputError(f"cells of shape {tuple(cells.shape)} do not fit batch {batch} and {self.grid}")
        x, y, weight = sample_certainty(ranges, self.rig, BeamTable(self.tangent, self.weight), self.reach)
        x, y = to_world(Pose(*(part.unsqueeze(-1).unsqueeze(-1) for part in pose)), x, y)
        add_at(cells, self.grid.find(x, y), weight * (1 / self.grid.cell**2))
        return self.grid.inner(cells), GridMapState(cells)

    @staticmethod
    def normalise(cells: Tensor) -> Tensor:
        """Cells divided by the largest of their map, 0..1; an empty map stays zero. [A §2.3]"""
        largest = cells.amax((-2, -1), keepdim=True)
        return cells / torch.where(largest > 0, largest, 1.0)


def check_observations(ranges: Ranges, pose: Pose) -> tuple[int, ...]:
    """The batch shape of ranges `[..., T, n]` seen from poses `[..., T]`, which must go together."""
    if ranges.x.ndim < 2 or ranges.x.shape[:-1] != pose.x.shape:
        raise InputError(
            f"expected ranges [..., T, n] and poses [..., T], got {tuple(ranges.x.shape)} and {tuple(pose.x.shape)}"
        )
    return tuple(ranges.x.shape[:-2])


def add_at(cells: Tensor, number: Tensor, weight: Tensor) -> Tensor:
    """Add weights `[..., T, n, S]` in place to the cells `[..., rows + 2, columns + 2]` of those numbers.

    Returns the numbers in `cells.view(-1)` of the cells that were touched, some of them more than once.
    """
    size = cells.shape[-2] * cells.shape[-1]
    if cells.ndim > 2:
        maps = torch.arange(cells.numel() // size, device=cells.device) * size
        number = number + maps.view(*cells.shape[:-2], 1, 1, 1)
    number = number.flatten()
    cells.view(-1).index_add_(0, number, weight.flatten())
    return number
