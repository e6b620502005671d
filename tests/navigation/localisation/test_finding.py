"""A place is found in a known map, whatever frame the car began in, and is not where two places look the same."""

import math

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Pose, StereoRig
from ndtorch.navigation.localisation import Localiser, LocaliserParams
from ndtorch.navigation.localisation.finding import carried_over, no_hunt, verdict
from ndtorch.navigation.localisation.walls import Scan, add_scan, empty_walls
from ndtorch.navigation.options import NavigatorOptions

pytest.importorskip("numba")

PARAMS = LocaliserParams(every=0.2)
DT = 0.2


def building(seed):
    """Points on the walls of a building of 9 x 6 m with a dozen oblique screens in it, `[n, 2]`."""
    rng = np.random.default_rng(seed)
    ends = [((0, 0), (9, 0)), ((9, 0), (9, 6)), ((9, 6), (0, 6)), ((0, 6), (0, 0))]
    for _ in range(12):
        x, y, turn = rng.uniform(0.5, 8.5), rng.uniform(0.5, 5.5), rng.uniform(0, math.pi)
        ends.append(((x, y), (x + math.cos(turn), y + math.sin(turn))))
    points = [np.linspace(a, b, int(20 * math.dist(a, b)) + 2) for a, b in ends]
    return np.concatenate(points) + rng.normal(0, 0.005, (sum(map(len, points)), 2))


def known_walls(points):
    return add_scan(empty_walls(PARAMS), Scan(*points.T.copy(), np.ones(len(points))), (0.0, 0.0, 0.0), PARAMS)


class Blindfold(Localiser):
    """It sees the points ahead of it without any rows: what is tested here is the search."""

    points, pose = None, (0.0, 0.0, 0.0)

    def scan(self, rows):
        x, y, heading = self.pose
        offset = self.points - (x, y)
        ahead = math.cos(heading) * offset[:, 0] + math.sin(heading) * offset[:, 1]
        aside = math.cos(heading) * offset[:, 1] - math.sin(heading) * offset[:, 0]
        seen = (ahead > 0.9) & (ahead < 5) & (np.abs(aside) < 0.75 * ahead)
        return Scan(ahead[seen][::6], aside[seen][::6], np.ones(len(ahead[seen][::6])))


@pytest.mark.slow
def test_it_finds_itself_from_an_unknown_start_and_goes_on_in_the_map():
    points = building(4)
    known = known_walls(points)
    localiser = Blindfold(StereoRig(), DT, PARAMS, known)
    localiser.points = points
    state, found = None, None
    for n in range(160):
        true = (4.5 + 1.6 * math.cos(0.06 * n), 3 + 1.6 * math.sin(0.06 * n), 0.06 * n + math.pi / 2)
        # The frame in which the car began: it is at its origin at first, turned by minus a right angle.
        own = (true[1] - 3, -(true[0] - 6.1), true[2] - math.pi / 2)
        localiser.pose = true
        state = localiser(torch.zeros(2, 8), Pose(*(torch.tensor(v) for v in own)), state)
        if found is None and state.hunt is None:
            found = n
    assert found is not None
    assert found > PARAMS.finding.way / (1.6 * 0.06)  # it has looked at more than one view
    assert [float(part) for part in state.pose] == pytest.approx(true, abs=0.03)
    assert torch.equal(localiser.known, known)


def test_two_places_that_look_the_same_are_not_told_apart():
    hunt = no_hunt()._replace(done=torch.tensor([[0.8, 1.0, 2.0, 0.1], [0.75, 5.0, 2.0, 0.1]], dtype=torch.float64))
    assert verdict(hunt, PARAMS) is None
    near = hunt._replace(done=torch.tensor([[0.8, 1.0, 2.0, 0.1], [0.75, 1.1, 2.0, 0.1]], dtype=torch.float64))
    assert verdict(near, PARAMS) == (1.0, 2.0, 0.1)
    poor = near._replace(done=near.done * torch.tensor([0.4, 1.0, 1.0, 1.0], dtype=torch.float64))
    assert verdict(poor, PARAMS) is None


def test_what_was_driven_during_the_search_is_carried_over():
    hunt = no_hunt()._replace(origin=torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64))
    found = carried_over(hunt, (5.0, 5.0, math.pi / 2), (3.0, 1.0, 0.2))
    assert found == pytest.approx((4.0, 7.0, math.pi / 2 + 0.2))


def test_a_map_without_walls_is_refused(tmp_path):
    from ndtorch.navigation import Grid
    from ndtorch.navigation.map_files import save_map

    grid = Grid(0, 1, 0, 1)
    save_map(tmp_path, torch.zeros(grid.rows, grid.columns), grid, np.zeros((0, 2)))
    with pytest.raises(InputError, match="localise"):
        NavigatorOptions(known_map=str(tmp_path)).navigator(StereoRig(), 30.0)
    save_map(tmp_path, torch.zeros(grid.rows, grid.columns), grid, np.zeros((0, 2)), torch.ones(1, 8))
    navigator = NavigatorOptions(known_map=str(tmp_path)).navigator(StereoRig(), 30.0)
    assert float(navigator.localiser.known.sum()) == 6.0
    with pytest.raises(InputError, match="walls"):
        Localiser(StereoRig(), DT, known=torch.zeros(2, 2, 6))


def test_before_the_first_search_there_is_a_place_and_nothing_found():
    hunt = no_hunt()
    assert [tuple(part.shape) for part in hunt] == [(0, 2), (3,), (), (0, 4), (0, 4), ()]
    assert {part.dtype for part in hunt} == {torch.float64}
    assert float(hunt.turn) == -1
