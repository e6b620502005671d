"""The local map and the visited cells lie where they were seen, wherever the car has gone since."""

from __future__ import annotations

import numpy as np
import pytest

from ndtorch.navigation.controllers.goal.replanning import local_map, visited_cells
from ndtorch.navigation.local_grid._kernels import LocalGrid
from ndtorch.navigation.local_grid.grid import LocalGridParams, cells_at, empty_grid

PARAMS = LocalGridParams(cell_m=0.05, size_cells=16)


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
    assert 0 <= car[0] + ahead - (around.left + column * PARAMS.cell_m) < PARAMS.cell_m
    assert 0 <= car[1] + aside - (around.bottom + row * PARAMS.cell_m) < PARAMS.cell_m
    # The car is in the middle.
    assert abs(around.left + 8 * PARAMS.cell_m - car[0]) <= PARAMS.cell_m
    assert abs(around.bottom + 8 * PARAMS.cell_m - car[1]) <= PARAMS.cell_m
    assert not around.free.any()
    assert (visited_cells(grid.evidence, *car, PARAMS, PARAMS) == around.blocked).all()
