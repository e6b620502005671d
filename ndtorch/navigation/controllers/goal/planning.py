"""From what is remembered of the surroundings to a way: a picture of the cells, their prices, and the two searches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.kernels.cost_to_go import cost_to_go
from ndtorch.kernels.find_way import find_way
from ndtorch.navigation.controllers.goal.params import WayParams

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]


class Surroundings(NamedTuple):
    """A rectangle of the world in cells, row after row from the smallest y.

    Attributes:
        blocked, free: what something was seen in, and what was seen to be floor, `[rows, columns]`.
        left, bottom: the world's x and y of the lower left corner, m.
        cell: side, m.
    """

    blocked: Bools
    free: Bools
    left: float
    bottom: float
    cell: float

    def cell_of(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of the cell that holds a place, or of the nearest one."""
        rows, columns = self.blocked.shape
        row, column = int((y - self.bottom) // self.cell), int((x - self.left) // self.cell)
        return min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)


def clearance(blocked: Bools, cell: float) -> Floats:
    """Distance from each cell to the middle of the nearest blocked one, m."""
    import cv2

    if not blocked.any():
        return np.full(blocked.shape, 99.0, np.float32)
    return np.asarray(cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, 5), np.float32) * np.float32(cell)


def hidden_cells(unknown: Bools, cell: float, radius: float) -> Floats:
    """1 where a disc would cover what was not seen; single cells that were missed do not count."""
    import cv2

    square = np.ones((3, 3), np.uint8)
    inside = cv2.morphologyEx(unknown.astype(np.uint8), cv2.MORPH_OPEN, square)
    if not inside.any():
        return np.zeros(unknown.shape, np.float32)
    away = cv2.distanceTransform(1 - inside, cv2.DIST_L2, 5)
    return np.asarray(away * cell < radius, np.float32)


def coarser(values: npt.NDArray[np.generic], by: int) -> Floats:
    """The least of each square of cells."""
    rows, columns = values.shape[0] // by * by, values.shape[1] // by * by
    squares = values[:rows, :columns].reshape(rows // by, by, columns // by, by)
    return np.asarray(squares.min((1, 3)), np.float32)


def prices(clear: Floats, unknown: Bools, params: WayParams, through: bool = True) -> Floats:
    """What a metre costs in each coarse cell.

    Args:
        clear: `clearance`; unknown: cells that were never seen.
        through: a way may lead through what is blocked, at a price; else it costs inf there, but for gaps that seem a
            little too narrow: a few cells more or less decide about a door.
    """
    p = params
    near, inner = coarser(clear, p.coarse), p.disc + p.margin
    price = 1.0 + p.tight_price * np.clip((p.soft - near) / (p.soft - inner), 0.0, 1.0)
    price += p.unknown_price * (coarser(~unknown, p.coarse) < 0.5)
    # Half a coarse cell is forgiven: a passage that just admits the car need not lie on the cells.
    shut = np.inf if not through else p.blocked_price
    price += np.where(near < inner - 0.03, np.where(near < p.shut, shut, p.blocked_price), 0.0)
    return np.asarray(price, np.float32)


def let_out(price: Floats, near: Floats, here: tuple[int, int], side: float, params: WayParams) -> None:
    """A car that stands nearer to something than a way may lead can leave, but not go nearer."""
    reach = round(0.5 / side)
    row, column = min(here[0], price.shape[0] - 1), min(here[1], price.shape[1] - 1)
    window = np.s_[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
    may = np.isinf(price[window]) & (near[window] > 0) & (near[window] >= near[row, column] - 0.05)
    price[window][may] = 1.0 + params.tight_price + params.blocked_price


def to_place(surroundings: Surroundings, place: tuple[float, float], params: WayParams) -> Floats:
    """Where a way may end and what that costs: at a place, or on the border towards it when it is outside."""
    s, by = surroundings, params.coarse
    rows, columns = (n // by for n in s.blocked.shape)
    seed = np.full((rows, columns), np.inf, np.float32)
    side = s.cell * by
    row, column = int((place[1] - s.bottom) // side), int((place[0] - s.left) // side)
    if 0 <= row < rows and 0 <= column < columns:
        seed[row, column] = 0.0
        return seed
    border = np.zeros(seed.shape, bool)
    border[[0, -1]], border[:, [0, -1]] = True, True
    r, c = np.nonzero(border)
    seed[r, c] = np.hypot(s.left + (c + 0.5) * side - place[0], s.bottom + (r + 0.5) * side - place[1])
    return seed


class Planned(NamedTuple):
    """What planning gave.

    Attributes:
        way: `[n, 5]`: x, y, heading, curvature driven to there, direction; the first row is the start. One row: none.
        cost: of the way from the start to an end of the seeds; inf where no end can be reached.
        clear, unknown: of the surroundings.
        to_go: `kernels.cost_to_go` from each coarse cell, of which no more was worked out than was needed.
    """

    way: Floats
    cost: float
    clear: Floats
    unknown: Floats
    to_go: Floats


def plan(
    surroundings: Surroundings,
    clear: Floats,
    seed: Floats,
    pose: tuple[float, float, float],
    curvature: float,
    direction: float,
    params: WayParams,
    through: bool = True,
) -> Planned:
    """The way of the next metres towards one of the ends.

    Args:
        clear: `clearance` of the surroundings.
        seed: `to_place` or `frontiers.to_unvisited`.
        pose: x, y, m, and heading, radians, of the car.
        curvature, direction: what it drives, 1/m and +1 or -1.
        through: as `prices`, and over what was not seen, however near. Without it a car that stands too near to
            something may leave all the same.
    """
    s, p = surroundings, params
    unknown = ~(s.free | s.blocked)
    row, column = s.cell_of(pose[0], pose[1])
    price = prices(clear, unknown, p, through)
    if not through:
        let_out(price, coarser(clear, p.coarse), (row // p.coarse, column // p.coarse), s.cell * p.coarse, p)
    rows, columns = price.shape
    here = min(row // p.coarse, rows - 1) * columns + min(column // p.coarse, columns - 1)
    cost = cost_to_go(price, seed, s.cell * p.coarse, here, 2.0 * p.horizon + 2.0)
    tight = 1 / p.radius
    start = np.array((*pose, curvature, direction), np.float32)
    away = unknown.astype(np.float32)
    if not np.isfinite(cost.ravel()[here]):
        return Planned(start[None], float("inf"), clear, away, cost)
    way = find_way(
        clear,
        away,
        hidden_cells(unknown, s.cell, p.disc),
        cost,
        s.left,
        s.bottom,
        s.cell,
        s.cell * p.coarse,
        start,
        np.array((0.0, tight / 2, -tight / 2, tight, -tight), np.float32),
        np.array(p.discs, np.float32),
        p.step,
        p.horizon,
        p.disc + p.margin,
        p.soft,
        p.tight_price,
        p.unknown_price,
        p.hidden_price,
        p.seen_soon,
        p.bend_price,
        p.swing_price,
        p.reverse_price,
        p.switch_price,
        0.0 if through else p.blind,
        p.most,
    )
    return Planned(way, float(cost.ravel()[here]), clear, away, cost)
