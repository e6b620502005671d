"""Tracks of figures: where they are looked for, and which pixels are theirs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import FOLLOWED, PATCH, PIXELS, SIGHTING, Figure
from ndtorch.binding.tracking.meeting import apart
from ndtorch.binding.tracking.regions import Regions
from ndtorch.binding.tracking.silhouettes import share

UNSEEN: Any = (np.zeros(4), np.zeros((3, PATCH, PATCH), np.float32), np.zeros(2), 0.0, 0.0, -1.0)
"""A track that was not looked at closely."""


@pytest.mark.parametrize(
    ("lost_for", "away", "found"), [(0.1, 0.1, True), (0.1, 0.15, False), (1.5, 0.2, True), (1.5, 0.3, False)]
)
def test_what_was_lost_for_longer_is_looked_for_farther_away(lost_for: float, away: float, found: bool) -> None:
    """A thing of a tenth of the picture that stood still: as far as its own size, and as much again every second."""
    params = FigureParams(gate=1.0, reach=1.0, unlike=0.0)
    two, ten = np.full(2, 0.1), np.zeros(10)
    seen = np.zeros((1, SIGHTING))
    seen[0, 0], seen[0, FOLLOWED], seen[0, PIXELS] = 5.0, 0.3, 0.01
    lost = Figure(1, True, np.zeros(2), two, np.zeros(3), two, 0.0, two, ten, ten, np.zeros(4), *UNSEEN, seen)
    labels = np.zeros((100, 160), np.int32)
    left = round(100 * (0.3 + away)) - 5
    labels[25:35, left : left + 10] = 1
    regions = Regions(labels, np.array([[25, left, 35, left + 10]]), np.array([100]))
    pairs = apart([lost], set(), {0: []}, regions, np.zeros((3, 100, 160)), 5.0 + lost_for, params)
    assert pairs == ([(0, 0)] if found else [])


def test_two_tracks_share_a_region_in_its_middle() -> None:
    """One is expected in the upper half, the other as far from the middle in the lower one: half of the pixels each."""
    ten, extent = np.zeros(10), np.full(2, 0.2)
    ones = []
    for number, row in enumerate((0.2, 0.4)):
        seen = np.zeros((1, SIGHTING))
        seen[0, FOLLOWED] = row, 0.3
        ones.append(
            Figure(number, True, ten[:2], extent, ten[:3], extent, 0.0, extent, ten, ten, np.zeros(4), *UNSEEN, seen)
        )
    labels, silhouettes = np.zeros((20, 20), np.int32), np.zeros((20, 20), np.int32)
    labels[2:10, 4:8] = 1
    box, picture, params = np.array([2, 4, 10, 8]), np.zeros((3, 20, 20), np.float32), FigureParams()
    share(silhouettes, labels, 0, box, ones, 0.0, picture, params)
    assert [int((silhouettes[2:10] == name).sum()) for name in (1, 2)] == [16, 16]
    assert (silhouettes[2:6, 4:8] == 1).all()
    # The lower one is red, and so is the picture's upper half.
    ones[1].color, picture[0, :6] = np.array([0.8, 0, 0]), 0.8
    share(silhouettes, labels, 0, box, ones, 0.0, picture, params)
    assert (silhouettes[2:5, 4:8] == 2).all()
    assert (silhouettes[7:10, 4:8] == 1).all()
    share(silhouettes, labels, 0, box, ones, 0.0, picture, FigureParams(own_color=0.0))
    assert (silhouettes[2:6, 4:8] == 1).all()


def test_a_figure_is_looked_for_where_it_should_be():
    seen = np.zeros((1, 10))
    seen[0, 0], seen[0, FOLLOWED] = 2.0, (0.4, 0.7)
    two, none = np.zeros(2), np.zeros(10)
    extent, looks = np.array([0.3, 0.1]), (none, none, two, *UNSEEN)
    figure = Figure(1, True, np.array([0.1, -0.2]), extent, two, two, 0.0, two, *looks, seen)
    assert figure.expected(3.0, 5.0) == pytest.approx([0.5, 0.5])
    assert figure.box(3.0, 5.0) == pytest.approx([0.35, 0.45, 0.65, 0.55])
    # It is not followed for ever.
    assert figure.box(9.0, 1.0) == pytest.approx([0.35, 0.45, 0.65, 0.55])
    assert figure.size == pytest.approx(0.2)
