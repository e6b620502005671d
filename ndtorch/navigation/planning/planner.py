"""A path through the local map around a car: costmap, Dijkstra, and A* on a lattice of arcs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError
from ndtorch.navigation.body import Body
from ndtorch.navigation.planning._kernels import (
    UNKNOWN_COST,
    Floats,
    Frame,
    LatticeNumbers,
    Layers,
    dijkstra,
    lattice_astar,
)

Bools = npt.NDArray[np.bool_]
Place = tuple[float, float, float]
"""x and y, m, and heading, radians."""

FAR_M = 99.0
"""Clearance where there is no obstacle."""

HIDDEN_M = 0.15
"""Unknown cells this near to an obstacle count as obstacles: only its front is ranged."""

COARSE = 2
"""A cell of the costmap is this many cells of the local map wide."""

NARROW_M = 0.03
"""Half a coarse cell is forgiven: a passage that just admits the car need not lie on the cells."""

LETHAL_M = 0.12
"""Exploring, no path has less clearance than this."""

DISCS = 4
"""Number of discs that cover the body."""

SPARE_RADIUS_RATIO = 0.9
"""Tightest turn of the body over that of a planned arc, so that the car can return to a path."""


class LocalMap(NamedTuple):
    """A rectangle of the world in cells, row after row from the smallest y.

    Attributes:
        blocked, free: obstacles and floor, `[rows, columns]`; neither is unknown.
        left, bottom: lower left corner, m.
        cell: side of a cell, m.
    """

    blocked: Bools
    free: Bools
    left: float
    bottom: float
    cell: float

    @property
    def unknown(self) -> Bools:
        """Cells that are neither blocked nor free."""
        return ~(self.free | self.blocked)

    def cells_of(self, x: Floats | float, y: Floats | float, coarse: int = 1) -> tuple[npt.NDArray[np.int64], ...]:
        """Rows and columns of the cells that hold points, or of the nearest ones."""
        at = zip((y, x), (self.bottom, self.left), self.blocked.shape, strict=True)
        side = self.cell * coarse
        return tuple(np.floor((v - low) / side).astype(int).clip(0, n // coarse - 1) for v, low, n in at)


class Plan(NamedTuple):
    """A planned path.

    Attributes:
        path: `[n, 6]`: x, y, heading, curvature driven to there, direction (+1 or -1), and speed, m/s; the first row is
            the start. One row: none.
        cost: of the path from the start to a goal; inf if none can be reached.
        to_go: `dijkstra` of each coarse cell, as far as was needed.
    """

    path: Floats
    cost: float
    to_go: Floats


class SpeedLimits(NamedTuple):
    """Speeds where there is room, where it is tight, into unknown cells, and backward, m/s, and deceleration, m/s^2."""

    cruise: float
    tight: float
    unknown: float
    reverse: float
    deceleration: float


@dataclass(frozen=True)
class Planner:
    """Plans paths of a body. A cost is a length: of a metre more, where nothing else is said.

    Args:
        body: outline and tightest turn.
        safety_margin_m: distance that is kept free around the body.
        inflation_radius_m: clearance of the middle line of the body from which on a path costs nothing more.
        horizon_m: length of a path.
        clearance_cost: a metre costs up to this much more below the inflation radius.
        obstacle_cost: a metre through obstacles costs this much more if no other path leads to the goal.
        reverse_cost_ratio: driving backward costs this many times as much.

    Raises:
        InputError: the inflation radius lies within the body.
    """

    body: Body
    safety_margin_m: float = 0.05
    inflation_radius_m: float = 0.45
    horizon_m: float = 2.6
    clearance_cost: float = 1.5
    obstacle_cost: float = 40.0
    reverse_cost_ratio: float = 2.5

    def __post_init__(self) -> None:
        if not self.inflation_radius_m > self.min_clearance_m:
            raise InputError(
                f"inflation_radius_m must be above {self.min_clearance_m:.3g}, got {self.inflation_radius_m}"
            )

    @cached_property
    def centers(self) -> Floats:
        """Centres of the discs that cover the body, along it, m."""
        return ((np.arange(DISCS, dtype=np.float32) + 0.5) / DISCS - 0.5) * np.float32(self.body.length_m)

    @cached_property
    def radius_m(self) -> float:
        """Radius of these discs."""
        return math.hypot(self.body.length_m / (2 * DISCS), self.body.width_m / 2)

    @cached_property
    def min_clearance_m(self) -> float:
        """Clearance that their centres keep."""
        return self.radius_m + self.safety_margin_m

    @cached_property
    def max_curvature_per_m(self) -> float:
        """Curvature of the tightest arc that is planned."""
        return 1 / max(self.body.min_turn_radius_m / SPARE_RADIUS_RATIO, self.body.length_m)

    def plan(
        self,
        m: LocalMap,
        goals: Floats,
        pose: Place,
        curvature: float,
        direction: float,
        limits: SpeedLimits,
        exploring: bool = False,
    ) -> Plan:
        """The path of the next metres towards one of the goals.

        Args:
            m: the local map.
            goals: cost of ending in each coarse cell, see `goal_costs` and `unvisited_costs`.
            pose: of the car.
            curvature, direction: that it drives, 1/m and +1 or -1.
            limits: of the speeds along the path.
            exploring: no path leads through obstacles.
        """
        clear = clearance(m.blocked if exploring else hidden(m), m.cell)
        cost = self.costmap(clear, m.unknown, exploring)
        side, (row, column) = m.cell * COARSE, m.cells_of(pose[0], pose[1], COARSE)
        index = int(row * cost.shape[1] + column)
        to_go = dijkstra(cost, goals, side, index, 2.0 * self.horizon_m + 2.0)
        start = np.array((*pose, curvature, direction), np.float32)
        if not math.isfinite(to_go[row, column]):
            return Plan(np.append(start, np.float32(0.0))[None], math.inf, to_go)
        frames = Frame(m.left, m.bottom, m.cell), Frame(m.left, m.bottom, side)
        layers, tight = Layers(clear, m.unknown.astype(np.float32), to_go, *frames), self.max_curvature_per_m
        numbers = LatticeNumbers(
            self.horizon_m, self.min_clearance_m, self.inflation_radius_m, self.clearance_cost, self.reverse_cost_ratio
        )
        curvatures = np.array((0.0, tight / 2, -tight / 2, tight, -tight), np.float32)
        path = lattice_astar(layers, start, curvatures, self.centers, numbers)
        speeds = self.speeds(path, m, clear, limits)
        return Plan(np.column_stack((path, speeds)).astype(np.float32), float(to_go[row, column]), to_go)

    def costmap(self, clear: Floats, unknown: Bools, exploring: bool = False) -> Floats:
        """Cost of a metre in each coarse cell.

        Args:
            clear: `clearance`.
            unknown: cells.
            exploring: a path costs inf through obstacles, except in gaps that seem a little too narrow: a few cells
                more or less decide about a door.
        """
        near = downscale(clear)
        lack = (self.inflation_radius_m - near) / (self.inflation_radius_m - self.min_clearance_m)
        cost = 1.0 + self.clearance_cost * np.clip(lack, 0.0, 1.0) + UNKNOWN_COST * (downscale(~unknown) < 0.5)
        cost += self.obstacle_cost * (near < self.min_clearance_m - NARROW_M)
        return np.where(exploring & (near < LETHAL_M), np.inf, cost).astype(np.float32)

    def unvisited_costs(self, m: LocalMap, visited: Bools) -> Floats:
        """Cost of ending in each coarse cell when exploring: 0 on floor that was seen and not visited, else inf."""
        fits = m.free & ~visited & (clearance(m.blocked, m.cell) > self.min_clearance_m)
        # Lone cells are false: a goal is three cells wide.
        return downscale(np.where(opened(fits), np.float32(0.0), np.float32(np.inf)))

    def speeds(self, path: Floats, m: LocalMap, clear: Floats, limits: SpeedLimits) -> Floats:
        """The speed at each point of a path `[n, 5]`, m/s: lower where it is tight and into unknown cells, 0 where the
        direction changes, and no higher than from where the car can brake to the speed of the next point."""
        x, y, heading, _, direction = path.astype(np.float64).T
        cos, sin = np.cos(heading), np.sin(heading)
        along = [m.cells_of(x + d * cos, y + d * sin) for d in self.centers.tolist()]
        room = np.min([clear[cells] for cells in along], 0)
        ratio = (room - self.min_clearance_m) / (self.inflation_radius_m - self.min_clearance_m)
        speeds = limits.tight + max(0.0, limits.cruise - limits.tight) * ratio.clip(0.0, 1.0)
        # Single unknown cells do not count.
        wide = opened(m.unknown)
        lead = direction * (self.centers[-1] + self.radius_m)
        unknown = wide[m.cells_of(x + lead * cos, y + lead * sin)]
        speeds = np.where(unknown, np.minimum(speeds, limits.unknown), speeds)
        speeds = np.where(direction < 0, np.minimum(speeds, limits.reverse), speeds)
        speeds[:-1][direction[1:] != direction[:-1]] = 0.0
        lengths = np.hypot(np.diff(x), np.diff(y))
        for n in range(len(path) - 2, -1, -1):
            speeds[n] = min(speeds[n], math.sqrt(speeds[n + 1] ** 2 + 2 * limits.deceleration * lengths[n]))
        return speeds.astype(np.float32)


def clearance(blocked: Bools, cell: float) -> Floats:
    """Distance from each cell to the middle of the nearest blocked one, m."""
    import cv2

    if not blocked.any():
        return np.full(blocked.shape, FAR_M, np.float32)
    return np.asarray(cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, 5), np.float32) * np.float32(cell)


def opened(cells: Bools) -> Bools:
    """Areas without parts that are less than three cells wide."""
    import cv2

    return np.asarray(cv2.morphologyEx(cells.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0)


def hidden(m: LocalMap) -> Bools:
    """The blocked cells, and the unknown ones within `HIDDEN_M` of them."""
    return np.asarray(m.blocked | (m.unknown & (clearance(m.blocked, m.cell) <= HIDDEN_M)))


def downscale(values: npt.NDArray[np.generic]) -> Floats:
    """The minimum of each square of `COARSE` x `COARSE` cells."""
    rows, columns = (n // COARSE * COARSE for n in values.shape)
    rows_of_two = np.minimum(values[:rows:COARSE], values[1:rows:COARSE])
    return np.minimum(rows_of_two[:, :columns:COARSE], rows_of_two[:, 1:columns:COARSE]).astype(np.float32)


def goal_costs(m: LocalMap, place: tuple[float, float]) -> Floats:
    """Cost of ending in each coarse cell: 0 at a place; on the border towards it if it is outside."""
    rows, columns = (n // COARSE for n in m.blocked.shape)
    costs, side = np.full((rows, columns), np.inf, np.float32), m.cell * COARSE
    row, column = int((place[1] - m.bottom) // side), int((place[0] - m.left) // side)
    if 0 <= row < rows and 0 <= column < columns:
        costs[row, column] = 0.0
        return costs
    r, c = np.indices(costs.shape)
    away = np.hypot(m.left + (c + 0.5) * side - place[0], m.bottom + (r + 0.5) * side - place[1])
    border = (r == 0) | (r == rows - 1) | (c == 0) | (c == columns - 1)
    return np.where(border, away, np.inf).astype(np.float32)
