"""Which tracks are objects."""

from __future__ import annotations

import numpy as np
import pytest

from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.following import patience, start, travels
from ndtorch.binding.tracking.restless import at_rest


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
