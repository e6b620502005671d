"""A place is found in a known map, whatever frame the car began in, and is not where two places look the same."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Pose, StereoRig
from ndtorch.navigation.localisation import Localiser, LocaliserParams
from ndtorch.navigation.localisation.finding import begin, carried_over, draw, middles, no_hunt, refine, verdict, vote
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


ALONG = np.stack((np.linspace(1.0, 3.0, 161), np.full(161, -1.1)), -1)
ACROSS = np.stack((np.full(97, 3.1), np.linspace(-1.0, 0.2, 97)), -1)
CORNER = np.concatenate((ALONG, ACROSS))
"""Two walls that meet, away from the origin."""


def test_cells_are_where_their_points_are():
    points = CORNER + np.random.default_rng(2).normal(0, 0.01, CORNER.shape)
    cells = {}
    for point in points:
        cells.setdefault(tuple(np.floor(point / PARAMS.cell).astype(int)), []).append(point)
    wanted = {at: np.array(them) for at, them in cells.items() if len(them) >= PARAMS.least}
    mean, spread = middles(known_walls(points), PARAMS)
    assert len(mean) == len(wanted)
    for middle, square in zip(mean, spread, strict=True):
        them = wanted.pop(tuple(np.floor(middle / PARAMS.cell).astype(int)))
        assert middle == pytest.approx(them.mean(0), abs=1e-4)
        assert square == pytest.approx(np.cov(them.T, bias=True), abs=1e-5)


def test_walls_are_drawn_as_bright_lines():
    f = PARAMS.finding
    picture = draw(known_walls(CORNER), PARAMS)
    rows, columns = np.indices(picture.light.shape)
    x, y = picture.left + columns * f.pixel, picture.bottom + rows * f.pixel
    away = np.hypot(x[..., None] - CORNER[:, 0], y[..., None] - CORNER[:, 1]).min(-1)
    near = away < 2.4 * f.blur
    assert near.sum() > 100
    assert picture.light[near] == pytest.approx(np.exp(-(away[near] ** 2) / (2 * f.blur**2)), abs=0.12)
    assert picture.light[away > 4 * f.blur].max() < 0.01
    assert x.min() == pytest.approx(1.0 - 4 * f.blur, abs=f.pixel)
    assert y.min() == pytest.approx(-1.1 - 4 * f.blur, abs=f.pixel)
    assert x.max() == pytest.approx(3.1 + 4 * f.blur, abs=f.pixel)
    assert y.max() == pytest.approx(0.2 + 4 * f.blur, abs=f.pixel)
    none = draw(empty_walls(PARAMS), PARAMS)
    assert (none.left, none.bottom) == (0, 0)
    assert none.light.tolist() == [[0.0]]


def test_a_search_begins_with_what_is_around_the_car():
    params = replace(PARAMS, finding=replace(PARAMS.finding, least=5, around=1.2))
    walls, pose = known_walls(CORNER), (2.2, -0.4, 2.0)
    middle = middles(walls, params)[0]
    near = middle[np.hypot(*(middle - pose[:2]).T) < 1.2]
    assert 5 < len(near) < len(middle)
    hunt = begin(no_hunt()._replace(way=torch.tensor(3.2, dtype=torch.float64)), walls, pose, params)
    turn = np.array([[math.cos(2.0), -math.sin(2.0)], [math.sin(2.0), math.cos(2.0)]])
    assert hunt.pattern.numpy() @ turn.T + pose[:2] == pytest.approx(near)
    assert hunt.origin.tolist() == list(pose)
    assert (float(hunt.turn), float(hunt.way)) == (0, 0)
    assert (len(hunt.places), len(hunt.done)) == (0, 0)
    scarce = replace(params, finding=replace(params.finding, least=len(near) + 1, again=0.7))
    later = begin(no_hunt()._replace(way=torch.tensor(3.2, dtype=torch.float64)), walls, pose, scarce)
    assert float(later.way) == pytest.approx(2.5)
    assert float(later.turn) == -1
    assert len(later.pattern) == 0
    enough = replace(params, finding=replace(params.finding, least=len(near)))
    assert float(begin(no_hunt(), walls, pose, enough).turn) == 0


def test_the_best_places_of_each_direction_are_tried_and_refined():
    params = replace(PARAMS, finding=replace(PARAMS.finding, around=3.0, kept=5))
    f, known = params.finding, known_walls(building(4))
    picture, heading = draw(known, params), 2 * math.pi * 20 / f.turns
    x, y = 6.04, 2.93
    hunt = begin(no_hunt(), known, (x, y, heading + 0.01), params)
    wrong = vote(hunt._replace(turn=torch.tensor(50.0, dtype=torch.float64)), picture, params)
    assert wrong.places.shape == (f.each, 4)
    assert float(wrong.turn) == 51
    assert wrong.places[:, 3].tolist() == [2 * math.pi * 50 / f.turns] * f.each
    tried = wrong._replace(turn=torch.tensor(20.0, dtype=torch.float64))
    tried = vote(tried, picture, params)
    assert len(tried.places) == 2 * f.each
    assert tried.places[0].tolist()[1:] == pytest.approx([x, y, heading], abs=f.stride * f.pixel)
    assert (tried.places[:-1, 0] >= tried.places[1:, 0]).all()
    assert 0.7 < float(tried.places[0, 0]) <= 1
    first, second = (one for one in tried.places.numpy() if one[3] == heading)
    assert np.abs(first[1:3] - second[1:3]).max() > 2.5 * f.stride * f.pixel  # not beside the best
    more = vote(tried._replace(turn=hunt.turn), picture, params)
    assert len(more.places) == f.kept
    fitted = refine(tried, known, params)
    assert torch.equal(fitted.places, tried.places[1:])
    score, *pose = fitted.done[0].tolist()
    assert pose == pytest.approx([x, y, heading + 0.01], abs=2e-3)
    assert score > 0.9
    again = refine(fitted, known, params)
    assert again.done.shape == (2, 4)
    assert torch.equal(again.done[:1], fitted.done)
    assert verdict(again, params) == tuple(pose)
    assert verdict(again._replace(done=again.done.flip(0)), params) == tuple(pose)


def test_a_search_goes_from_step_to_step_and_ends_where_a_place_was_found():
    params = replace(PARAMS, finding=replace(PARAMS.finding, turns=3, way=1.0, least=10))
    known = known_walls(building(4))
    localiser = Localiser(StereoRig(), DT, params, known)
    zero = torch.zeros((), dtype=torch.float64)
    start = localiser.start(Pose(zero + 6.0, zero + 3.0, zero + 0.5))
    state = start._replace(walls=known)
    waiting = no_hunt()._replace(way=zero + 0.9)
    assert localiser.find(state, waiting).hunt is waiting  # not far enough yet
    state = localiser.find(state, no_hunt()._replace(way=zero + 1.1))
    assert float(state.hunt.turn) == 0
    assert len(state.hunt.pattern) > 10
    for turn in (1, 2, 3):
        state = localiser.find(state, state.hunt)
        assert float(state.hunt.turn) == turn
    assert len(state.hunt.places) == 3 * params.finding.each
    state = localiser.find(state, state.hunt)
    assert (len(state.hunt.places), len(state.hunt.done)) == (3 * params.finding.each - 1, 1)
    ended = state.hunt._replace(places=state.hunt.places[:0], way=zero + 0.4)
    done = torch.tensor([[0.9, 2.0, 1.0, 0.5 + math.pi / 2]], dtype=torch.float64)
    moved = state._replace(pose=Pose(zero + 7.0, zero + 3.0, zero + 0.6), walls=empty_walls(params))
    found = localiser.find(moved, ended._replace(done=done))
    assert found.hunt is None
    assert torch.equal(found.walls, known)
    # It has driven a metre since, and the frame is turned by a right angle.
    assert [float(part) for part in found.pose] == pytest.approx([2.0, 2.0, 0.6 + math.pi / 2])
    lost = localiser.find(moved, ended._replace(done=done * torch.tensor([0.1, 1, 1, 1], dtype=torch.float64)))
    assert [float(part) for part in lost.pose] == [7.0, 3.0, 0.6]
    assert (float(lost.hunt.turn), float(lost.hunt.way), len(lost.hunt.done)) == (-1, 0.4, 0)
    assert torch.equal(lost.walls, moved.walls)
