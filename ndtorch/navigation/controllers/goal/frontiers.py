"""Where exploring may go: places that were seen and never passed, and where the unknown begins."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.navigation.controllers.goal.params import WayParams
from ndtorch.navigation.controllers.goal.planning import Bools, Floats, Surroundings, coarser


def to_unvisited(surroundings: Surroundings, visited: Bools, clear: Floats, params: WayParams) -> Floats:
    """Where a way may end when exploring and what that costs, `[rows, columns]` of coarse cells; inf elsewhere.

    Floor that was seen and never passed costs nothing. What was never seen counts where it borders on floor, also
    beside the way that was driven: a door beside the car is in no picture. It comes second.

    Args:
        visited: cells that count as passed, `[rows, columns]`.
        clear: `clearance`.
    """
    s, p = surroundings, params
    fits = (clear > p.disc + p.margin) & ~visited
    # Lone cells are false: what is worth a way is two cells wide all around.
    seen = large(opened(s.free & fits, 3), p.least_seen / s.cell**2)
    unknown = large(opened(~(s.free | s.blocked) & fits, 7), p.least_unseen / s.cell**2)
    border = unknown & widened(opened(s.free & (clear > p.disc), 3), 5)
    cost = np.where(border, np.float32(p.unseen_end), np.float32(np.inf))
    return coarser(np.where(seen, np.float32(0.0), cost), p.coarse)


def opened(cells: Bools, wide: int) -> Bools:
    """What is left of areas without parts that are less than so many cells wide."""
    import cv2

    square = np.ones((wide, wide), np.uint8)
    return np.asarray(cv2.morphologyEx(cells.astype(np.uint8), cv2.MORPH_OPEN, square) > 0)


def widened(cells: Bools, wide: int) -> Bools:
    """Areas and what is around them, half of so many cells."""
    import cv2

    return np.asarray(cv2.dilate(cells.astype(np.uint8), np.ones((wide, wide), np.uint8)) > 0)


def large(cells: Bools, least: float) -> Bools:
    """Those of the areas that have at least so many cells."""
    import cv2

    _, labels, stats, _ = cv2.connectedComponentsWithStats(cells.astype(np.uint8), connectivity=4)
    enough = stats[:, cv2.CC_STAT_AREA] >= least
    enough[0] = False
    return np.asarray(enough[labels])


def where_to(cost: Floats, around: Surroundings, coarse: int, here: tuple[float, float]) -> tuple[float, float]:
    """The end of the cheapest way from a place, x and y in m.

    Args:
        cost: `Planned.to_go`; coarse: cells along a side of one of its cells.
    """
    side = around.cell * coarse
    rows, columns = cost.shape
    row = min(max(int((here[1] - around.bottom) // side), 0), rows - 1)
    column = min(max(int((here[0] - around.left) // side), 0), columns - 1)
    while math.isfinite(cost[row, column]):
        low, left = max(row - 1, 0), max(column - 1, 0)
        square = cost[low : row + 2, left : column + 2]
        down, across = (part.ravel() for part in np.indices(square.shape))
        lower = np.flatnonzero(square.ravel() < cost[row, column])
        if not len(lower):
            break
        # Of neighbours that are as cheap the nearer one lies on the way.
        length = np.hypot(low + down[lower] - row, left + across[lower] - column)
        best = lower[(square.ravel()[lower] + side * length).argmin()]
        row, column = low + int(down[best]), left + int(across[best])
    return around.left + (column + 0.5) * side, around.bottom + (row + 0.5) * side
