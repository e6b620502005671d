"""The local map and the visited cells lie where they were seen, wherever the car has gone since."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ndtorch.navigation.controllers.goal.replanning import disc_cells, local_map, visited_cells
from ndtorch.navigation.local_grid._kernels import LocalGrid, move_grid
from ndtorch.navigation.local_grid.grid import LocalGridParams, cells_at, empty_grid

PARAMS = LocalGridParams(cell=0.05, size=16)


def marked(car: tuple[float, float], x: list[float], y: list[float], weight: float, p: LocalGridParams) -> LocalGrid:
    grid = empty_grid(*car, p)
    grid.evidence.reshape(-1)[cells_at((*car, 0.0), x, y, p)] = weight
    return grid


@pytest.mark.parametrize("car", [(0.0, 0.0), (0.42, 3.17), (-1.33, 0.38), (2.51, -4.04)])
def test_what_is_seen_lies_where_it_is_in_the_world(car: tuple[float, float]) -> None:
    ahead, aside = 0.21, -0.13
    grid = marked(car, [ahead], [aside], 3.0, PARAMS)
    around = local_map(grid.evidence, *car, PARAMS, blocked=2.0, free=-0.5)
    assert around.blocked.shape == (16, 16)
    ((row, column),) = np.argwhere(around.blocked)
    assert 0 <= car[0] + ahead - (around.left + column * PARAMS.cell) < PARAMS.cell
    assert 0 <= car[1] + aside - (around.bottom + row * PARAMS.cell) < PARAMS.cell
    # The car is in the middle.
    assert abs(around.left + 8 * PARAMS.cell - car[0]) <= PARAMS.cell
    assert abs(around.bottom + 8 * PARAMS.cell - car[1]) <= PARAMS.cell
    assert not around.free.any()
    assert (visited_cells(grid.evidence, *car, PARAMS, PARAMS) == around.blocked).all()


@pytest.mark.parametrize("car", [(0.0, 0.0), (0.42, 3.17), (-1.33, 0.38), (2.51, -4.04)])
def test_what_was_visited_may_lie_in_larger_cells_that_reach_farther(car: tuple[float, float]) -> None:
    places = LocalGridParams(cell=0.1, size=32)
    grid = marked(car, [0.21, 1.2], [-0.13, 0.0], 1.0, places)
    cells = visited_cells(grid.evidence, *car, PARAMS, places)
    assert cells.shape == (16, 16)
    rows, columns = np.nonzero(cells)
    assert len(rows) == 4
    around = local_map(np.zeros((16, 16), np.float32), *car, PARAMS, blocked=2.0, free=-0.5)
    x, y = around.left + (columns + 0.5) * PARAMS.cell, around.bottom + (rows + 0.5) * PARAMS.cell
    assert np.abs(x - (car[0] + 0.21)).max() < places.cell
    assert np.abs(y - (car[1] - 0.13)).max() < places.cell
    # After a way of more than the small square, and back, they are there still.
    away = move_grid(grid, (car[0] + 0.9, car[1], 0.0), places.cell, 1.0)
    assert float(away.evidence.sum()) == 2


def test_a_disc_is_round_and_full() -> None:
    places = disc_cells(0.22, PARAMS)
    radius = np.hypot(*places)
    assert float(radius.max()) == pytest.approx(math.hypot(3, 3) * PARAMS.cell)
    assert places.shape[1] == 61
    assert float(places.sum()) == pytest.approx(0, abs=1e-6)


def test_a_disc_holds_its_rim():
    x, y = disc_cells(0.5, LocalGridParams(cell=0.25))
    assert len(x) == 13
    assert (x * x + y * y).max() == 0.25
