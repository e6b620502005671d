"""NDT cells hold the moments of their points; a scan is matched to where it was taken."""

import numpy as np
import pytest

from ndtorch.navigation.localisation._kernels import MIN_WEIGHT
from ndtorch.navigation.localisation.ndt import (
    Scan,
    add_scan,
    distributions,
    empty_map,
    from_sparse,
    match_scan,
    to_sparse,
)
from tests.navigation.localisation.worlds import PARAMS, building, map_of

CELL = PARAMS.cell_m
ALONG = np.stack((np.linspace(1.0, 3.0, 161), np.full(161, -1.1)), -1)
ACROSS = np.stack((np.full(97, 3.1), np.linspace(-1.0, 0.2, 97)), -1)
CORNER = np.concatenate((ALONG, ACROSS))
"""Two walls that meet, away from the origin."""


def test_cells_hold_mean_and_covariance_of_their_points():
    points = CORNER + np.random.default_rng(2).normal(0, 0.01, CORNER.shape)
    cells = {}
    for point in points:
        cells.setdefault(tuple(np.floor(point / CELL).astype(int)), []).append(point)
    wanted = {at: np.array(them) for at, them in cells.items() if len(them) >= MIN_WEIGHT}
    mean, covariance = distributions(map_of(points), CELL)
    assert len(mean) == len(wanted)
    for middle, square in zip(mean, covariance, strict=True):
        them = wanted.pop(tuple(np.floor(middle / CELL).astype(int)))
        assert middle == pytest.approx(them.mean(0), abs=1e-4)
        assert square == pytest.approx(np.cov(them.T, bias=True), abs=1e-5)


def test_a_map_is_not_changed_by_adding_a_scan_and_survives_a_file():
    before = map_of(CORNER)
    kept = before.copy()
    after = add_scan(before, Scan(*CORNER.T, np.ones(len(CORNER))), np.array((0.5, 0.2, 0.3)), CELL)
    assert np.array_equal(before, kept)
    sparse = to_sparse(after)
    assert np.array_equal(from_sparse(sparse, len(after)), after)
    small = from_sparse(sparse, 24)  # 3 m to each side
    assert 0 < len(to_sparse(small)) < len(sparse)


def test_a_scan_is_matched_to_the_pose_at_which_it_was_taken():
    points, pose = building(4), np.array((4.0, 3.0, 0.7))
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    offset = points[np.hypot(*(points - pose[:2]).T) < 3] - pose[:2]
    scan = Scan(offset @ (cos, sin), offset @ (-sin, cos), np.ones(len(offset)))
    match = match_scan(map_of(points), scan, pose + np.array((0.06, -0.05, 0.03)), (0.3, 0.3), CELL)
    assert match.pose == pytest.approx(pose, abs=2e-3)
    assert match.score == pytest.approx(0.5, abs=0.2)  # the mean of exp(-d^2 / 2) of a Gaussian
    nowhere = match_scan(empty_map(PARAMS.map_cells), scan, pose, (0.3, 0.3), CELL)
    assert nowhere.score == 0
    assert nowhere.pose == pytest.approx(pose)
    assert not nowhere.information.any()
