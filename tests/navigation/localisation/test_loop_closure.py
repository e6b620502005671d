"""Loop closures are matched within the uncertainty of the graph; one that would move a room needs a second one."""

import numpy as np
import pytest

from ndtorch.navigation.localisation import LocaliserParams, SubmapParams
from ndtorch.navigation.localisation.loop_closure import accept_and_optimise, is_consistent, match_submaps
from ndtorch.navigation.localisation.ndt import Scan, ScanMatch
from ndtorch.navigation.localisation.odometry_edge import empty_edge
from ndtorch.navigation.localisation.submap import (
    Calibration,
    Submap,
    SubmapGraph,
    add_to_submap,
    empty_graph,
    finish_submap,
)

PARAMS, DT = LocaliserParams(), 1 / 30
HERE, EXACT = np.zeros(3), Calibration(np.zeros(3), np.full(3, 1e-3))
COUNT, ROOM, FAR = 10, 4, 0.38
STEP = np.array((1.0, 0.0, 0.0))


def odometry(sigma):
    """An edge of a metre ahead."""
    return empty_edge()._replace(pose=STEP, length=1.0, variance=np.array((sigma**2, 1e-6)))


def closure(first, second, off=0.0, sigma=0.02):
    """The second submap is where odometry says, but for an offset to the side, m."""
    place = sigma**-2.0
    return np.array([[first, second, second - first, off, 0, place, 0, place, 0, 0, 1e4]], float)


def row_of_submaps(count, closures):
    """Submaps in a row, of which those from the fifth on are a room: certain among each other, less so beyond."""
    none, line = np.zeros((0, 8)), np.arange(count + 1.0)
    edges = [odometry(0.1 if n == ROOM else 0.005) for n in range(count)]
    submaps = tuple(Submap(none, none[:, :2], none[:, :3], edge) for edge in edges)
    poses = np.stack((line, 0 * line, 0 * line), -1)
    return empty_graph(HERE, PARAMS)._replace(
        submaps=submaps, poses=poses, begun=line, odometry=odometry(0.005), loop_closures=np.concatenate(closures)
    )


def aside(graph):
    """How far the room has moved aside, m."""
    return float(graph.poses[ROOM:COUNT, 1].mean())


def after(graph, *closures, params=PARAMS.submaps):
    """With one more submap and its closures."""
    more = row_of_submaps(len(graph.submaps) + 1, [graph.loop_closures, *closures])
    poses = np.concatenate((graph.poses, graph.poses[-1:] + STEP))
    return accept_and_optimise(more._replace(poses=poses, unconfirmed=graph.unconfirmed), EXACT, params)


@pytest.fixture
def held():
    """The newest of ten submaps has a closure with the first that would move the room."""
    graph = row_of_submaps(COUNT, [closure(ROOM, ROOM + 1), closure(0, COUNT - 1, FAR)])
    return accept_and_optimise(graph, EXACT, PARAMS.submaps)


def test_one_closure_does_not_move_a_room(held):
    assert held.unconfirmed[:, :2].tolist() == [[0, COUNT - 1]]
    assert held.loop_closures[:, :2].tolist() == [[ROOM, ROOM + 1]]
    assert abs(aside(held)) < 0.01


def test_a_second_closure_that_agrees_moves_it(held):
    again = after(held, closure(1, COUNT, FAR))
    assert not len(again.unconfirmed)
    assert sorted(again.loop_closures[:, 1].tolist()) == [ROOM + 1, COUNT - 1, COUNT]
    assert aside(again) > 0.03  # two iterations, in which an outlier has less weight


def test_a_second_closure_that_disagrees_waits_too(held):
    again = after(held, closure(1, COUNT, -FAR))
    assert len(again.unconfirmed) == 2
    assert abs(aside(again)) < 0.01


def test_closures_of_one_submap_do_not_confirm_each_other():
    graph = row_of_submaps(COUNT, [closure(0, COUNT - 1, FAR), closure(1, COUNT - 1, FAR)])
    graph = accept_and_optimise(graph, EXACT, PARAMS.submaps)
    assert len(graph.unconfirmed) == 2
    assert not len(graph.loop_closures)


def test_a_closure_that_moves_nothing_is_accepted_at_once():
    graph = accept_and_optimise(row_of_submaps(COUNT, [closure(0, COUNT - 1, 0.01)]), EXACT, PARAMS.submaps)
    assert not len(graph.unconfirmed)


def test_an_unconfirmed_closure_is_dropped_in_the_end(held):
    short = SubmapParams(confirmation_max_submaps=1)
    assert len(after(held, closure(COUNT - 1, COUNT)).unconfirmed) == 1
    assert not len(after(held, closure(COUNT - 1, COUNT), params=short).unconfirmed)


def wall(count, left=0.0):
    """A scan of as many cells of a wall, eight points each."""
    x = left + np.arange(8 * count) / 32 + 0.01
    return Scan(x, 0.4 + 0 * x, np.ones(len(x)))


def mapped(scan, graph=None):
    return add_to_submap(graph or empty_graph(HERE, PARAMS), scan, HERE, PARAMS.cell_m)


def finished(graph, age) -> SubmapGraph:
    return finish_submap(graph, HERE, age, DT, EXACT, PARAMS)


def two_submaps(sigma):
    """Two submaps of the same wall with a corner at its end, placed 0.2 m apart."""
    corner = np.linspace(0.4, 1.4, 32)
    scans = [
        Scan(*(np.r_[a, b] for a, b in zip(wall(12), (0 * corner + 3 + off, corner, 1 + 0 * corner), strict=True)))
        for off in (0.0, 0.2)
    ]
    graph = finished(mapped(scans[0]), 60)
    edge = empty_edge()._replace(variance=np.array((sigma**2, 1e-6)))
    return finished(mapped(scans[1], graph._replace(odometry=edge)), 120)


def test_a_match_is_searched_for_within_the_uncertainty_of_the_graph():
    sure, unsure = (match_submaps(two_submaps(sigma), PARAMS) for sigma in (0.001, 0.2))
    assert not len(sure.candidates)
    assert not len(sure.loop_closures) or abs(sure.loop_closures[0, 2]) < 0.05
    assert unsure.loop_closures[0, :2].tolist() == [0, 1]
    assert unsure.loop_closures[0, 2] == pytest.approx(-0.2, abs=0.03)


@pytest.mark.parametrize(("sigma", "accepted"), [(0.02, False), (0.2, True)])
def test_a_match_far_from_the_expected_pose_is_accepted_only_if_that_is_uncertain(sigma, accepted):
    match = ScanMatch(0.3, 0.0, 0.0, 0.9, np.array((1e5, 0.0, 1e5, 0.0, 0.0, 1e5)))
    assert is_consistent(match, HERE, np.diag([sigma**2] * 3)) == accepted
