"""Which tracks are objects."""

from __future__ import annotations

import numpy as np
import pytest

from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.following import EDGE, add, part_of_another, patience, start, travels
from ndtorch.binding.tracking.restless import at_rest
from ndtorch.binding.tracking.silhouettes import Sighting


@pytest.mark.parametrize(
    ("size", "gone", "params", "is_one"),
    [
        (0.2, 0.15, FigureParams(), True),
        (0.2, 0.13, FigureParams(), False),
        # Pieces of leaves and of noise wander by more than their own size.
        (0.04, 0.045, FigureParams(), False),
        (0.04, 0.055, FigureParams(), True),
        (0.04, 0.045, FigureParams(way=0.0), True),
        (0.2, 0.0, FigureParams(travel=0.0), True),
    ],
)
def test_an_object_has_gone_a_share_of_its_size_and_of_the_picture(
    size: float, gone: float, params: FigureParams, is_one: bool
) -> None:
    one = start(0, 0.0, np.array([0.5, 0.5]))
    one.extent = np.array([size, size])
    for n in range(26):
        column = 0.5 + gone * n / 25
        one.late.append((n / 25, 0.5, column, 0.5, column, 0.5, column, 0.01, 0.5, column))
    assert travels(one, at_rest(112, 199), 0.04, params) is is_one


@pytest.mark.parametrize(("dt", "waited"), [(0.04, 0.3), (0.32, 0.48)])
def test_a_track_is_waited_for_until_the_next_picture(dt: float, waited: float) -> None:
    """At 3 frames a second every track was over before it could be seen again."""
    one = start(0, 0.0, np.array([0.5, 0.5]))
    one.late.append((0.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.01, 0.5, 0.5))
    assert patience(one, dt, FigureParams()) == pytest.approx(waited)


PARTS = FigureParams()
SMALL, LARGE = 0.01, 0.01 * PARTS.larger
NEAR = PARTS.beside * 0.2


@pytest.mark.parametrize(
    ("gap", "pixels", "slower", "seen", "is_part"),
    [
        (0.9 * NEAR, LARGE, 0.9 * PARTS.fate, 1.0, True),
        (1.1 * NEAR, LARGE, 0.9 * PARTS.fate, 1.0, False),
        (0.9 * NEAR, 0.99 * LARGE, 0.9 * PARTS.fate, 1.0, False),
        (0.9 * NEAR, LARGE, 1.1 * PARTS.fate, 1.0, False),
        (0.9 * NEAR, LARGE, 0.9 * PARTS.fate, 0.9, False),
    ],
)
@pytest.mark.parametrize("side", range(4))
def test_what_moves_with_something_much_larger_beside_it_is_a_part_of_it(
    side: int, gap: float, pixels: float, slower: float, seen: float, is_part: bool
) -> None:
    one, other = (start(n, 0.0, np.array([0.5, 0.5])) for n in range(2))
    other.extent, one.extent = np.array([0.2, 0.2]), np.array([0.1, 0.1])
    away = np.array([(0, 1), (0, -1), (1, 0), (-1, 0)][side]) * (gap + 0.15)
    for each, time, (row, column), half, size in (
        (one, 1.0, 0.5 + away, 0.05, SMALL),
        (other, seen, (0.5, 0.5), 0.1, pixels),
    ):
        each.late.append((time, row, column, row - half, column - half, row + half, column + half, size, row, column))
    other.velocity, one.velocity = np.array([0.0, 1.0]), np.array([0.0, 1.0 - slower])
    assert part_of_another(one, [one, other], PARTS) is is_part


@pytest.mark.parametrize(
    ("grows", "column", "known", "anew"),
    [
        (1.1 * PARTS.alike_size, 0.5, False, True),
        (0.9 * PARTS.alike_size, 0.5, False, False),
        (1.1 * PARTS.alike_size, 0.5, True, False),
        # What is coming in grows as well.
        (1.1 * PARTS.alike_size, 0.1 + 0.9 * EDGE, False, False),
        (1.1 * PARTS.alike_size, 1.5 - 0.9 * EDGE, False, False),
    ],
    ids=["at once", "by and by", "an object", "at the left edge", "at the right edge"],
)
def test_what_is_much_larger_at_once_begins_its_way_anew(grows: float, column: float, known: bool, anew: bool) -> None:
    """The picture is 1.6 heights wide, and the track .2."""
    one = start(0, 0.0, np.array([0.5, 0.4]))
    one.known = known
    for time, at, pixels in ((0.0, 0.4, 0.01), (0.04, column, 0.01 * grows)):
        place = (0.5, at)
        add(one, time, Sighting(place, place, (0.2, 0.2), pixels, np.zeros(3), np.zeros(4), 0.0, False), 1.6, PARTS)
    assert one.start.tolist() == ([0.5, column] if anew else [0.5, 0.4])
