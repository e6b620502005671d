"""What is remembered lies where it was seen, wherever the car has gone since."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from ndtorch.navigation import Pose
from ndtorch.navigation.controllers.goal.memory import disc_cells, surroundings, visited_cells
from ndtorch.navigation.controllers.ranging.patch import PatchParams, add_evidence, cell_numbers, empty_patch

PARAMS = PatchParams(cell=0.05, size=16)


def at(x: float, y: float) -> Pose:
    return Pose(torch.tensor(x), torch.tensor(y), torch.tensor(0.0))


@pytest.mark.parametrize("car", [(0.0, 0.0), (0.42, 3.17), (-1.33, 0.38), (2.51, -4.04)])
def test_what_is_seen_lies_where_it_is_in_the_world(car: tuple[float, float]) -> None:
    pose = at(*car)
    ahead, aside = 0.21, -0.13
    number = cell_numbers(torch.tensor([[ahead], [aside]]), pose, PARAMS)
    patch = add_evidence(empty_patch(pose, PARAMS), number, torch.tensor([3.0]), PARAMS)
    around = surroundings(patch.evidence, *car, PARAMS, blocked=2.0, known=-0.5)
    assert around.blocked.shape == (16, 16)
    ((row, column),) = np.argwhere(around.blocked)
    assert 0 <= car[0] + ahead - (around.left + column * PARAMS.cell) < PARAMS.cell
    assert 0 <= car[1] + aside - (around.bottom + row * PARAMS.cell) < PARAMS.cell
    # The car is in the middle.
    assert abs(around.left + 8 * PARAMS.cell - car[0]) <= PARAMS.cell
    assert abs(around.bottom + 8 * PARAMS.cell - car[1]) <= PARAMS.cell
    assert not around.free.any()
    assert (visited_cells(patch.evidence, *car, PARAMS) == around.blocked).all()


def test_a_disc_is_round_and_full() -> None:
    places = disc_cells(0.22, PARAMS)
    radius = places.norm(dim=0)
    assert float(radius.max()) == pytest.approx(math.hypot(3, 3) * PARAMS.cell)
    assert places.shape[1] == 61
    assert float(places.sum()) == pytest.approx(0, abs=1e-6)
