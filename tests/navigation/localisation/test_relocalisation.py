"""A pose is found in a known map, whatever frame the car began in, unless two places look the same."""

import math

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Grid, StereoRig
from ndtorch.navigation.localisation import Localiser
from ndtorch.navigation.localisation.ndt import empty_map
from ndtorch.navigation.localisation.relocalisation import BLUR_M, PIXEL_M, best_pose, likelihood_field, no_search
from ndtorch.navigation.mapping import save_map
from ndtorch.navigation.options import NavigatorOptions
from tests.navigation.localisation.test_ndt import CORNER
from tests.navigation.localisation.worlds import DT, PARAMS, PointLocaliser, building, map_of

CELL, P = PARAMS.cell_m, PARAMS.relocalisation


@pytest.mark.slow
def test_it_finds_itself_from_an_unknown_start_and_goes_on_in_the_map():
    points = building(4)
    known = map_of(points)
    localiser = PointLocaliser(StereoRig(), DT, points, known=known)
    n = np.arange(160)
    true = np.stack((4.5 + 1.6 * np.cos(0.06 * n), 3 + 1.6 * np.sin(0.06 * n), 0.06 * n + math.pi / 2), -1)
    # The frame in which the car began: it is at its origin at first, turned by minus a right angle.
    own = np.stack((true[:, 1] - 3, 6.1 - true[:, 0], true[:, 2] - math.pi / 2), -1)
    found, _, states = localiser.drive(true, own)
    first = next(n for n, state in enumerate(states) if state.relocalisation is None)
    assert first > P.first_search_m / (1.6 * 0.06)  # it has looked at more than one view
    assert found[-1] == pytest.approx(true[-1], abs=0.03)
    assert np.array_equal(localiser.known, map_of(points))


def test_two_places_that_look_the_same_are_not_told_apart():
    search = no_search()._replace(refined=np.array([[0.8, 1.0, 2.0, 0.1], [0.75, 5.0, 2.0, 0.1]]))
    assert best_pose(search, P) is None
    near = search._replace(refined=np.array([[0.8, 1.0, 2.0, 0.1], [0.75, 1.1, 2.0, 0.1]]))
    assert best_pose(near, P).tolist() == [1.0, 2.0, 0.1]
    assert best_pose(near._replace(refined=near.refined * (0.4, 1.0, 1.0, 1.0)), P) is None


def test_a_map_without_ndt_cells_is_refused(tmp_path):
    grid = Grid(0, 1, 0, 1)
    save_map(tmp_path, torch.zeros(grid.rows, grid.columns), grid, np.zeros((0, 2)))
    with pytest.raises(InputError, match="localise"):
        NavigatorOptions(known_map=str(tmp_path)).navigator(StereoRig(), 30.0)
    cells = np.ones((1, 8), np.float32)
    save_map(tmp_path, torch.zeros(grid.rows, grid.columns), grid, np.zeros((0, 2)), cells)
    navigator = NavigatorOptions(known_map=str(tmp_path)).navigator(StereoRig(), 30.0)
    assert float(navigator.localiser.known.sum()) == 6.0
    with pytest.raises(InputError, match="known map"):
        Localiser(StereoRig(), DT, known=empty_map(2))


def test_the_likelihood_field_falls_with_the_distance_from_walls():
    field = likelihood_field(map_of(CORNER), CELL)
    rows, columns = np.indices(field.values.shape)
    x, y = field.left + columns * PIXEL_M, field.bottom + rows * PIXEL_M
    away = np.hypot(x[..., None] - CORNER[:, 0], y[..., None] - CORNER[:, 1]).min(-1)
    near = away < 2.4 * BLUR_M
    assert near.sum() > 100
    assert field.values[near] == pytest.approx(np.exp(-(away[near] ** 2) / (2 * BLUR_M**2)), abs=0.12)
    assert field.values[away > 4 * BLUR_M].max() < 0.01
    border = (x.min() - 1.0, y.min() + 1.1, 3.1 - x.max(), 0.2 - y.max())
    assert border == pytest.approx([-4 * BLUR_M] * 4, abs=PIXEL_M)
    none = likelihood_field(empty_map(PARAMS.map_cells), CELL)
    assert (none.left, none.bottom, none.values.tolist()) == (0, 0, [[0.0]])
