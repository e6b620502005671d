"""The local map around the car, its clearance, and the costmap of it."""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.navigation.planning._kernels import Floats
from ndtorch.navigation.planning.params import PlannerParams

Bools = npt.NDArray[np.bool_]

FAR_M = 99.0
"""Clearance where there is no obstacle."""

EXIT_M = 0.5
"""Around a car that is nearer to obstacles than the lethal radius this far is freed."""

NARROW_M = 0.03
"""Half a coarse cell is forgiven: a passage that just admits the car need not lie on the cells."""


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

    def cell_of(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of the cell that holds a place, or of the nearest one."""
        rows, columns = self.blocked.shape
        row, column = int((y - self.bottom) // self.cell), int((x - self.left) // self.cell)
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)


def clearance(blocked: Bools, cell: float) -> Floats:
    """Distance from each cell to the middle of the nearest blocked one, m."""
    import cv2

    if not blocked.any():
        return np.full(blocked.shape, FAR_M, np.float32)
    return np.asarray(cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, 5), np.float32) * np.float32(cell)


def with_backs(local_map: LocalMap, depth: float) -> Bools:
    """The blocked cells, and the unknown ones within `depth` of them, m: of an obstacle only the front is ranged."""
    m = local_map
    return np.asarray(m.blocked | (m.unknown & (clearance(m.blocked, m.cell) <= depth)))


def unseen_cells(unknown: Bools, cell: float, radius: float) -> Floats:
    """1 where a disc would cover unknown cells; single unknown cells do not count."""
    import cv2

    inside = cv2.morphologyEx(unknown.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    if not inside.any():
        return np.zeros(unknown.shape, np.float32)
    away = cv2.distanceTransform(1 - inside, cv2.DIST_L2, 5)
    return np.asarray(away * cell < radius, np.float32)


def downscale(values: npt.NDArray[np.generic], by: int) -> Floats:
    """The minimum of each square of cells."""
    rows, columns = (n // by * by for n in values.shape)
    parts = (values[row:rows:by, column:columns:by] for row in range(by) for column in range(by))
    return np.asarray(reduce(np.minimum, parts), np.float32)


def costmap(clear: Floats, unknown: Bools, params: PlannerParams, through: bool = True) -> Floats:
    """Cost of a metre in each coarse cell.

    Args:
        clear: `clearance`.
        unknown: cells.
        through: a path may lead through obstacles at a cost; else it costs inf there, except in gaps that seem a little
            too narrow: a few cells more or less decide about a door.
    """
    p = params
    near = downscale(clear, p.costmap_cells)
    share = (p.inflation_radius_m - near) / (p.inflation_radius_m - p.min_clearance_m)
    cost = 1.0 + p.clearance_cost * np.clip(share, 0.0, 1.0)
    cost += p.unknown_cost * (downscale(~unknown, p.costmap_cells) < 0.5)
    lethal = p.obstacle_cost if through else np.inf
    blocked = near < p.min_clearance_m - NARROW_M
    cost += np.where(blocked, np.where(near < p.lethal_radius_m, lethal, p.obstacle_cost), 0.0)
    return np.asarray(cost, np.float32)


def clear_footprint(cost: Floats, near: Floats, here: tuple[int, int], side: float, params: PlannerParams) -> None:
    """Let a car leave that is nearer to an obstacle than the lethal radius, but not go nearer.

    Args:
        cost: `costmap`, changed in place.
        near: clearance of its cells, whose side is `side`, m.
        here: row and column of the car.
    """
    reach = round(EXIT_M / side)
    row, column = min(here[0], cost.shape[0] - 1), min(here[1], cost.shape[1] - 1)
    window = np.s_[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
    may = np.isinf(cost[window]) & (near[window] > 0) & (near[window] >= near[row, column] - 0.05)
    cost[window][may] = 1.0 + params.clearance_cost + params.obstacle_cost
