import numpy as np
import pytest

from ndtorch.navigation.localisation.compact_map import compact_map, expand_map
from ndtorch.navigation.localisation.ndt import Scan, add_scan, distributions, empty_map

CELL = 0.25


def a_map(size: int = 64):
    """Walls that are 2 cm thick."""
    rng = np.random.default_rng(1)
    along, thick = rng.uniform(-6, 6, 4000), rng.normal(0, 0.02, 4000)
    turn = np.repeat(rng.uniform(0, np.pi, 20), 200)
    x, y = np.cos(turn) * along - np.sin(turn) * thick, np.sin(turn) * along + np.cos(turn) * thick
    return add_scan(empty_map(size), Scan(x, y, np.ones(4000)), np.zeros(3), CELL)


def test_a_compact_map_has_the_cells_of_the_map():
    """Means to a millimetre, and deviations to half a step of a quarter."""
    before = a_map()
    after = expand_map(compact_map(before, CELL, (0.0, 0.0)), 64, CELL)
    (mean, covariance), (found, ellipse) = distributions(before, CELL), distributions(after, CELL)
    np.testing.assert_allclose(found, mean, atol=0.001)
    for n in range(2):
        ratio = np.sqrt(np.linalg.eigvalsh(ellipse)[:, n] / np.linalg.eigvalsh(covariance)[:, n].clip(0.005**2))
        np.testing.assert_allclose(ratio, 1.0, atol=0.13)


def test_it_takes_six_bytes_a_cell_and_keeps_those_near_home():
    before, home = a_map(), (4.0, -3.0)
    cells = len(distributions(before, CELL)[0])
    assert len(compact_map(before, CELL, home)) <= 6 * cells + 30
    few = distributions(expand_map(compact_map(before, CELL, home, 20), 64, CELL), CELL)[0]
    away = np.sort(np.hypot(*(distributions(before, CELL)[0] - home).T))
    assert len(few) == 20
    assert np.hypot(*(few - home).T).max() == pytest.approx(away[19], abs=0.002)


def test_an_empty_map_is_empty():
    assert not expand_map(compact_map(empty_map(64), CELL, (0.0, 0.0)), 64, CELL).any()
