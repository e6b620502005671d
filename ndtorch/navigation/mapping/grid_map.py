"""Grid map: certainties or log-odds of all ranged features, summed in cells of the world."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_number, check_numbers, check_state, check_tensor
from ndtorch.errors import InputError
from ndtorch.navigation.mapping.certainty import REACH, beam_table, sample_certainty
from ndtorch.navigation.odometry import Pose, to_world
from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch.navigation.stereo.rig import StereoRig

Certainty = Literal["beams", "log-odds"]

HIT, MISS, LIMIT = 2.0, 0.1, 6.0
"""Log-odds, `log(p / (1 - p))` for the probability p that a cell is occupied: what an observation adds in all, spread
over its cells; what it takes from each cell on its line of sight; and their largest size, so that maps can change."""

CLEAR_RATIO = 0.85  # ratio of the range up to which the line of sight counts as free

BITS = 6
SIDE = 1 << BITS
"""Cells along the side of a tile: a step of a map touches a dozen tiles of 16 KB, where the grid has megabytes."""


@dataclass(frozen=True)
class Grid:
    """A rectangle of the world divided into square cells.

    Args:
        left, right: the x of its sides, m; bottom, top: the y of them.
        cell: side of a cell, m; [A] uses 1 cm.

    Raises:
        InputError: an empty rectangle, or one of more than 2^31 cells.

    >>> grid = Grid(0.0, 8.0, -3.0, 3.0, cell=0.1)
    >>> grid.rows, grid.columns
    (60, 80)
    """

    left: float = -10.0
    right: float = 10.0
    bottom: float = -10.0
    top: float = 10.0
    cell: float = 0.01

    def __post_init__(self) -> None:
        check_numbers(self)
        if not (self.left < self.right and self.bottom < self.top and self.cell > 0):
            raise InputError(f"expected left < right, bottom < top and cell > 0, got {self}")
        wide, high = (self.right - self.left) / self.cell, (self.top - self.bottom) / self.cell
        if not (wide < 2**31 and high < 2**31 and self.rows * self.columns < 2**31):
            raise InputError(f"{self} has {high:.4g} x {wide:.4g} cells, which is too many")

    @property
    def rows(self) -> int:
        return math.ceil(round((self.top - self.bottom) / self.cell, 6))

    @property
    def columns(self) -> int:
        return math.ceil(round((self.right - self.left) / self.cell, 6))

    def inner(self, cells: Tensor) -> Tensor:
        """The cells of the state without their margin, a view `[..., rows, columns]`."""
        return cells.narrow(-2, 1, self.rows).narrow(-1, 1, self.columns)

    def find(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """Row and column of the cell that holds each point; 0 and the last one are the margin outside."""
        # Truncation is a floor here: the cells begin at 1, and what is below falls into the margin, 0.
        scale = 1 / self.cell
        column = ((x - (self.left - self.cell)) * scale).clamp(0, self.columns + 1).to(torch.int64)
        row = ((y - (self.bottom - self.cell)) * scale).clamp(0, self.rows + 1).to(torch.int64)
        return row, column

    def center(self, row: Tensor, column: Tensor) -> tuple[Tensor, Tensor]:
        """x and y of the middle of a cell, m."""
        return self.left + (column + 0.5) * self.cell, self.bottom + (row + 0.5) * self.cell


class GridMapState(NamedTuple):
    """State of `GridMap`: summed certainty, or log-odds, in tiles.

    The first and last cell of the grid's rows and columns are a margin that collects what lies outside. Tiles are never
    changed: an update replaces those it touches and shares the rest with the state before. Empty tiles are one and the
    same tensor.

    Attributes:
        tiles: row after row of tiles `[..., SIDE, SIDE]`.
    """

    tiles: tuple[tuple[Tensor, ...], ...]

    @property
    def cells(self) -> Tensor:
        """All cells `[..., R, C]`, put together anew; `Grid.inner` cuts out the grid's."""
        return torch.cat([torch.cat(row, -1) for row in self.tiles], -2)

    def add(self, row: Tensor, column: Tensor, weight: Tensor, limit: float | None = None) -> GridMapState:
        """The state with weights `[..., k]` added to cells; changed tiles are then clamped to `limit` on both sides."""
        across, batch, last = len(self.tiles[0]), row.shape[:-1], SIDE - 1
        touched, slot = torch.unique((row >> BITS) * across + (column >> BITS), return_inverse=True)
        numbers = touched.tolist()
        if not numbers:
            return self
        sums = torch.stack([self.tiles[n // across][n % across] for n in numbers])  # the copy, [m, ..., SIDE, SIDE]
        car = torch.arange(batch.numel(), device=row.device).view(*batch, 1)
        cell = (slot * batch.numel() + car << 2 * BITS) + ((row & last) << BITS) + (column & last)
        sums.view(-1).index_add_(0, cell.flatten(), weight.flatten())
        if limit is not None:
            sums.clamp_(-limit, limit)
        rows = list(map(list, self.tiles))
        for n, new in zip(numbers, sums.unbind(0), strict=True):
            rows[n // across][n % across] = new.clone()  # a view would keep all of `sums`
        return GridMapState(tuple(map(tuple, rows)))


class GridMap(nn.Module):
    """Allocentric map: what was ranged, placed at the dead-reckoned poses.

    With `certainty="beams"` it is the map of [A §2.3]: the value of a cell is the mean of `certainty` over its area,
    summed over all observations. `normalise` divides by the largest, which the paper does once at the end. With
    `"log-odds"` it is the Bayesian map that [A §2.3] leaves open: each observation adds log-odds where its feature
    is certain to be, and takes some away on the line of sight before it; `cells` are log-odds and 0 is unknown.

    Called as `cells, state = grid_map(ranges, pose, state)`; row 0 of `cells` is at the smallest y. Only cells near
    the beams are touched, and `update` gives the state without putting all cells together. What lies outside the grid
    is ignored.

    Shapes:
        ranges `[..., T, n]`, pose `[..., T]` -> cells `[..., rows, columns]`. `state=None` starts empty.

    Args:
        rig: the camera pair.
        grid: the part of the world to map.
        reach: space constant R_b of the beams, m.
        farthest: range up to which points along a beam are at most half a cell apart, m.
        certainty: what a cell holds, `"beams"` or `"log-odds"`.
        spread_px: standard deviation of a beam, pixels; [A] has 1.

    Raises:
        InputError: ranges and poses that do not belong together, or a state of another grid.
    """

    tangent: Tensor
    weight: Tensor
    line: Tensor

    def __init__(
        self,
        rig: StereoRig,
        grid: Grid | None = None,
        reach: float = REACH,
        farthest: float = 2.2,
        certainty: Certainty = "beams",
        spread_px: float = 1.0,
    ) -> None:
        super().__init__()
        check_number("reach", reach, above=0, unit="metres", endless=True)
        check_number("farthest", farthest, above=0, unit="metres")
        check_number("spread_px", spread_px, above=0, unit="pixels")
        if certainty not in get_args(Certainty):
            raise InputError(f"certainty must be 'beams' or 'log-odds', got {certainty!r}")
        self.rig, self.grid, self.reach = rig, grid or Grid(), reach
        self.certainty = certainty
        tangent, weight = beam_table(rig, farthest, self.grid.cell / 2, spread_px=spread_px)
        self.register_buffer("tangent", tangent, persistent=False)
        self.register_buffer("weight", weight, persistent=False)
        # One point a cell at the farthest range: nearer lines meet a cell more often than once, see `sight`.
        line = torch.linspace(0.0, CLEAR_RATIO, math.ceil(farthest / self.grid.cell))
        self.register_buffer("line", line, persistent=False)

    def forward(self, ranges: Ranges, pose: Pose, state: GridMapState | None = None) -> tuple[Tensor, GridMapState]:
        state = self.update(ranges, pose, state)
        return self.grid.inner(state.cells), state

    def update(self, ranges: Ranges, pose: Pose, state: GridMapState | None = None) -> GridMapState:
        """The state after ranges `[..., T, n]` taken at poses `[..., T]`."""
        check_state(state, GridMapState)
        batch, grid = check_observations(ranges, pose), self.grid
        across, down = -(-(grid.columns + 2) // SIDE), -(-(grid.rows + 2) // SIDE)
        if state is None:
            state = GridMapState(((ranges.x.new_zeros(*batch, SIDE, SIDE),) * across,) * down)
        size = (*state.tiles[0][0].shape[:-2], len(state.tiles), len(state.tiles[0]))
        if size != (*batch, down, across):
            raise InputError(f"state.tiles {size} do not fit batch {batch} and a grid of {grid.rows} x {grid.columns}")
        at = Pose(pose.x[..., None, None], pose.y[..., None, None], pose.heading[..., None, None])
        if self.certainty == "beams":
            x, y, weight = sample_certainty(ranges, self.rig, self.tangent, self.weight, self.reach)
            row, column = grid.find(*to_world(at, x, y))
            weight = weight * (1 / grid.cell**2)
            return state.add(row.flatten(-3), column.flatten(-3), weight.flatten(-3))
        x, y, change = self.sight(ranges)
        row, column = (part.flatten(-2) for part in grid.find(*to_world(at, x, y)))
        for t in range(row.shape[-2]):  # frame by frame, because no frame may take a cell over the limit
            state = state.add(row[..., t, :], column[..., t, :], change[..., t, :, :].flatten(-2), LIMIT)
        return state

    def sight(self, ranges: Ranges) -> tuple[Tensor, Tensor, Tensor]:
        """Points of the features and on the lines of sight to them, and the change of log-odds there."""
        x, y, weight = sample_certainty(ranges, self.rig, self.tangent, self.weight, math.inf)
        hits = weight / weight.sum(-1, keepdim=True).clamp(min=torch.finfo(weight.dtype).tiny)
        valid = ranges.valid.unsqueeze(-1).to(hits.dtype)
        ahead, aside = ranges.x.unsqueeze(-1) - self.rig.forward, ranges.y.unsqueeze(-1)
        # Several points of the line may fall into one cell: together they take `miss`.
        length = torch.hypot(ahead, aside) * float(self.line[-1])
        crowding = (length / (len(self.line) * self.grid.cell)).clamp(max=1.0)
        line_x, line_y = self.rig.forward + ahead * self.line, aside * self.line
        free = (-MISS * crowding * valid).expand(line_x.shape)
        change = torch.cat((hits * valid * HIT, free), -1)
        return torch.cat((x, line_x), -1), torch.cat((y, line_y), -1), change

    def normalised(self, state: GridMapState | None) -> Tensor:
        """The normalised map `[..., rows, columns]`; zeros before anything was mapped."""
        if state is None:
            return torch.zeros(self.grid.rows, self.grid.columns)
        return self.normalise(self.grid.inner(state.cells))

    @staticmethod
    def normalise(cells: Tensor) -> Tensor:
        """Cells divided by the largest of their map, 0..1; what is less than zero becomes zero. [A §2.3]"""
        cells = cells.clamp(min=0)
        largest = cells.amax((-2, -1), keepdim=True)
        return cells / torch.where(largest > 0, largest, 1.0)


def check_observations(ranges: Ranges, pose: Pose) -> tuple[int, ...]:
    """The batch shape of ranges `[..., T, n]` and poses `[..., T]`, which must be finite and of one shape."""
    for name, value in (*zip(Pose._fields, pose, strict=True), ("x", ranges.x), ("y", ranges.y)):
        check_tensor(name, value, half=False)
    if ranges.x.ndim < 2 or ranges.x.shape[:-1] != pose.x.shape:
        raise InputError(
            f"ranges and poses must go together, ranges.x [..., T, n] and pose.x [..., T], "
            f"got {tuple(ranges.x.shape)} and {tuple(pose.x.shape)}"
        )
    return tuple(ranges.x.shape[:-2])
