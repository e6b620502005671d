"""Which tracks are objects."""

from __future__ import annotations

import numpy as np
import pytest

from ndtorch.tracking.clutter import empty_clutter_map
from ndtorch.tracking.confirmation import travels_enough
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.track import Track, max_missed_time


@pytest.mark.parametrize(
    ("size", "gone", "params", "is_one"),
    [
        (0.2, 0.15, TrackingParams(), True),
        (0.2, 0.13, TrackingParams(), False),
        # Pieces of leaves and of noise wander by more than their own size.
        (0.04, 0.045, TrackingParams(), False),
        (0.04, 0.055, TrackingParams(), True),
        (0.04, 0.045, TrackingParams(min_travel_height_ratio=0.0), True),
        (0.2, 0.0, TrackingParams(min_travel_sizes=0.0), True),
    ],
)
def test_an_object_has_gone_a_share_of_its_size_and_of_the_picture(
    size: float, gone: float, params: TrackingParams, is_one: bool
) -> None:
    one = Track.begin(0, 0.0, np.array([0.5, 0.5]))
    one.extent = (size, size)
    for n in range(26):
        column = 0.5 + gone * n / 25
        one.new_detections.append((n / 25, 0.5, column, 0.5, column, 0.5, column, 0.01, 0.5, column))
    assert travels_enough(one, empty_clutter_map(112, 199), params) is is_one


@pytest.mark.parametrize(("dt", "waited"), [(0.04, 0.3), (0.32, 0.48)])
def test_a_track_is_waited_for_until_the_next_picture(dt: float, waited: float) -> None:
    """At 3 frames a second every track was over before it could be seen again."""
    one = Track.begin(0, 0.0, np.array([0.5, 0.5]))
    one.new_detections.append((0.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.01, 0.5, 0.5))
    assert max_missed_time(one, dt, TrackingParams()) == pytest.approx(waited)
