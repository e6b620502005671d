"""A fit that would move a whole room waits until a fit of another part says the same."""

import numpy as np
import pytest
import torch

from ndtorch.navigation.localisation import LocaliserParams
from ndtorch.navigation.localisation.agreeing import settled
from ndtorch.navigation.localisation.params import PartParams
from ndtorch.navigation.localisation.parts import Part, Parts, no_parts
from ndtorch.navigation.localisation.way import Way, no_way

NOTHING, COUNT, ROOM, FAR = (np.zeros(3), np.full(3, 1e-3)), 10, 4, 0.38
STEP = torch.tensor((1.0, 0.0, 0.0), dtype=torch.float64)


def way(unsure: float) -> Way:
    """A metre ahead."""
    variances = torch.tensor((unsure**2, 1e-6), dtype=torch.float64)
    return no_way()._replace(pose=STEP, length=STEP[0], unsure=variances)


def fit(first: int, second: int, off: float = 0.0, sure: float = 0.02) -> torch.Tensor:
    """That the second part is where the way says, but for so many metres aside."""
    place = sure**-2.0
    return torch.tensor([[first, second, second - first, off, 0, place, 0, place, 0, 0, 1e4]], dtype=torch.float64)


def row(count: int, edges: list[torch.Tensor]) -> Parts:
    """So many parts in a row, of which all from the fifth on are a room: sure of each other, less so of the rest."""
    empty, line = torch.zeros(0, 8), torch.arange(count + 1, dtype=torch.float64)
    unsure = [0.1 if n == ROOM else 0.005 for n in range(count)]
    done = tuple(Part(empty, empty[:, :2], empty[:, :3], way(one)) for one in unsure)
    poses = torch.stack((line, 0 * line, 0 * line), -1)
    parts = no_parts((0.0, 0.0, 0.0), LocaliserParams())
    return parts._replace(done=done, poses=poses, begun=line, came=way(0.005), edges=torch.cat(edges))


def aside(parts: Parts) -> float:
    """How far the room has come aside, m."""
    return float(parts.poses[ROOM:COUNT, 1].mean())


def after(parts: Parts, *fits: torch.Tensor, params: LocaliserParams | None = None) -> Parts:
    """With one more part, and its fits."""
    more = row(len(parts.done) + 1, [parts.edges, *fits])
    poses = torch.cat((parts.poses, parts.poses[-1:] + STEP))
    return settled(more._replace(poses=poses, waiting=parts.waiting), *NOTHING, params or LocaliserParams())


@pytest.fixture
def held() -> Parts:
    """The newest part of ten has a fit to the first that would take the room along."""
    return settled(row(COUNT, [fit(ROOM, ROOM + 1), fit(0, COUNT - 1, FAR)]), *NOTHING, LocaliserParams())


def test_one_fit_does_not_move_a_room(held):
    assert held.waiting[:, :2].tolist() == [[0, COUNT - 1]]
    assert held.edges[:, :2].tolist() == [[ROOM, ROOM + 1]]
    assert abs(aside(held)) < 0.01


def test_a_second_fit_that_says_the_same_moves_it(held):
    again = after(held, fit(1, COUNT, FAR))
    assert not len(again.waiting)
    assert sorted(again.edges[:, 1].tolist()) == [ROOM + 1, COUNT - 1, COUNT]
    assert aside(again) > 0.03  # two steps of the graph, in which what is far off counts less


def test_a_second_fit_that_says_otherwise_waits_too(held):
    again = after(held, fit(1, COUNT, -FAR))
    assert len(again.waiting) == 2
    assert abs(aside(again)) < 0.01


def test_fits_of_one_part_do_not_confirm_each_other():
    parts = settled(row(COUNT, [fit(0, COUNT - 1, FAR), fit(1, COUNT - 1, FAR)]), *NOTHING, LocaliserParams())
    assert len(parts.waiting) == 2
    assert not len(parts.edges)


def test_a_fit_that_says_where_the_room_is_known_to_be_counts_at_once():
    parts = settled(row(COUNT, [fit(0, COUNT - 1, 0.01)]), *NOTHING, LocaliserParams())
    assert not len(parts.waiting)


def test_what_nothing_confirms_is_given_up(held):
    short = LocaliserParams(parts=PartParams(patience=1))
    assert len(after(held, fit(COUNT - 1, COUNT)).waiting) == 1
    assert not len(after(held, fit(COUNT - 1, COUNT), params=short).waiting)
