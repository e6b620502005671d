"""Frontiers of exploration: floor that was seen and not visited, and the border of the unknown."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.navigation.planning._kernels import Floats
from ndtorch.navigation.planning.costmap import Bools, LocalMap, downscale
from ndtorch.navigation.planning.params import PlannerParams


def frontier_costs(local_map: LocalMap, visited: Bools, clear: Floats, params: PlannerParams) -> Floats:
    """Cost of ending in each coarse cell when exploring, `[rows, columns]`; inf where there is no frontier.

    Floor that was seen and not visited costs nothing. Unknown areas are frontiers where they border on floor, also
    beside the driven path, as a door beside the car is in no image; they cost more.

    Args:
        visited: cells `[rows, columns]`.
        clear: `clearance`.
    """
    m, p = local_map, params
    fits = (clear > p.min_clearance_m) & ~visited
    # Lone cells are false: a frontier is two cells wide all around.
    seen = large_components(opening(m.free & fits, 3), p.min_seen_frontier_m2 / m.cell**2)
    unknown = large_components(opening(m.unknown & fits, 7), p.min_unknown_frontier_m2 / m.cell**2)
    border = unknown & dilate(opening(m.free & (clear > p.footprint_radius_m), 3), 5)
    cost = np.where(border, np.float32(p.unknown_frontier_cost_m), np.float32(np.inf))
    return downscale(np.where(seen, np.float32(0.0), cost), p.costmap_cells)


def opening(cells: Bools, size: int) -> Bools:
    """Areas without parts that are less than this many cells wide."""
    import cv2

    square = np.ones((size, size), np.uint8)
    return np.asarray(cv2.morphologyEx(cells.astype(np.uint8), cv2.MORPH_OPEN, square) > 0)


def dilate(cells: Bools, size: int) -> Bools:
    """Areas widened by half of this many cells."""
    import cv2

    return np.asarray(cv2.dilate(cells.astype(np.uint8), np.ones((size, size), np.uint8)) > 0)


def large_components(cells: Bools, least: float) -> Bools:
    """Connected areas of at least this many cells."""
    import cv2

    _, labels, stats, _ = cv2.connectedComponentsWithStats(cells.astype(np.uint8), connectivity=4)
    enough = stats[:, cv2.CC_STAT_AREA] >= least
    enough[0] = False
    return np.asarray(enough[labels])


def cheapest_goal(to_go: Floats, local_map: LocalMap, coarse: int, here: tuple[float, float]) -> tuple[float, float]:
    """x and y, m, of the goal of the cheapest path from a place.

    Args:
        to_go: of `Plan`.
        coarse: cells of the local map along a side of one of its cells.
    """
    m, side = local_map, local_map.cell * coarse
    rows, columns = to_go.shape
    row = min(max(int((here[1] - m.bottom) // side), 0), rows - 1)
    column = min(max(int((here[0] - m.left) // side), 0), columns - 1)
    while math.isfinite(to_go[row, column]):
        low, left = max(row - 1, 0), max(column - 1, 0)
        square = to_go[low : row + 2, left : column + 2]
        down, across = (part.ravel() for part in np.indices(square.shape))
        lower = np.flatnonzero(square.ravel() < to_go[row, column])
        if not len(lower):
            break
        # Of neighbours that cost the same the nearer one lies on the path.
        length = np.hypot(low + down[lower] - row, left + across[lower] - column)
        best = lower[(square.ravel()[lower] + side * length).argmin()]
        row, column = low + int(down[best]), left + int(across[best])
    return m.left + (column + 0.5) * side, m.bottom + (row + 0.5) * side
