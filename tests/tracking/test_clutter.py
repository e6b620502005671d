"""What comes and goes and never becomes an object makes its place restless; what passes there has to go further."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.tracking.clutter import CLUTTER_DECAY_S, clutter_at, empty_clutter_map, update_clutter_map
from ndtorch.tracking.confirmation import travels_enough
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.track import Track, TrackState
from ndtorch_train.benchmark.negative_clips import leaves
from tests.foreground.passing_scenes import SIZE, ground

P = TrackingParams()
DT = 0.04


def track(
    number: int, left: float, right: float, seconds: float = 0.4, known: bool = False, size: float = 0.1
) -> Track:
    """A track of a square that goes from left to right in the middle of the picture."""
    steps = round(seconds / DT)
    columns = np.linspace(left, right, steps)
    one = Track.begin(number, 0.0, np.array([0.5, columns[0]]))
    one.state, one.extent = TrackState(known), 2 * (size,)
    for n, column in enumerate(columns.tolist()):
        box = (0.5 - size / 2, column - size / 2, 0.5 + size / 2, column + size / 2)
        one.new_detections.append((n * DT, 0.5, column, *box, size**2, 0.5, column))
    return one


def test_counts_those_that_never_were_objects_and_forgets_them() -> None:
    before = empty_clutter_map(112, 199)
    gone = update_clutter_map(before, [track(0, 0.3, 0.32), track(1, 0.3, 0.34)], [], DT, P)
    there, elsewhere = track(2, 0.31, 0.31), track(3, 1.2, 1.2)
    assert clutter_at(there, gone) == pytest.approx(2, rel=0.3)
    assert clutter_at(elsewhere, gone) == 0
    assert not before.any()
    for _ in range(round(CLUTTER_DECAY_S / DT)):
        gone = update_clutter_map(gone, [], [], DT, P)
    assert clutter_at(there, gone) == pytest.approx(2 / np.e, rel=0.3)


def test_where_others_came_and_went_one_has_to_go_further() -> None:
    quiet = empty_clutter_map(112, 199)
    gone = quiet + np.float32(1)
    short, long = (
        track(0, 0.3, 0.3 + 1.5 * P.min_travel_sizes * 0.1),
        track(1, 0.3, 0.3 + 1.1 * P.clutter_travel_factor * P.min_travel_sizes * 0.1),
    )
    assert travels_enough(short, quiet, P)
    assert not travels_enough(short, gone, P)
    assert travels_enough(long, gone, P)


@pytest.mark.slow
def test_a_thing_that_crosses_restless_ground_is_found() -> None:
    """Patches of leaves sway for 12 s. From 8 s on a bright square crosses them."""
    fps, count = 25, 300
    still = np.asarray(ground().permute(1, 2, 0).numpy())
    film = torch.stack([torch.from_numpy(frame) for frame in leaves(still, np.random.default_rng(6), count)])
    film = film.permute(0, 3, 1, 2).clamp(0, 1)
    for n in range(8 * fps, count):
        left = 2 * (n - 8 * fps)
        film[n, :, 44:68, left : left + 24] = 0.9
    # Without what tells leaves from things, leaves are objects.
    blind = {"tracking.clutter_travel_factor": 1.0, "tracking.probation_s": 0.0}
    blind |= {"tracking.clutter_rate": 1e9, "tracking.clutter_density": 1e9}
    counts = []
    for options in ({}, blind):
        model = ndtorch.load("foreground", size=SIZE, fps=fps, **options)
        with torch.inference_mode():
            _, state = model(film)
        objects = model.objects(state)
        assert any(one.heading[0] > 0.7 * SIZE[1] for one in objects)
        counts.append(len(objects))
    assert counts[0] == 1 < counts[1]
