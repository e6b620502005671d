"""One of many things of a size that come all over the picture, or close together, is no object: snow, and glints."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.tracking.clutter import BIRTH, CLUTTER_WINDOW_S, RADIUS, empty_clutter_map, is_particle_clutter
from ndtorch.tracking.confirmation import confirm
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.rigid_motion import revoke_confirmation
from ndtorch.tracking.track import Track, TrackState
from ndtorch_train.benchmark.negative_clips import snow
from tests.foreground.passing_scenes import SIZE, ground

P = TrackingParams()
DT, WIDTH = 0.04, 1.6
STILL = np.zeros((50, 80), np.uint8)
STEPS = int(P.min_track_s / DT) + 2


def track(
    number: int, place: tuple[float, float], size: float = 0.05, steps: int = STEPS, known: bool = False
) -> Track:
    """A square that stays where it is, seen from time 0 on."""
    one = Track.begin(number, 0.0, np.array(place))
    one.state, one.extent = TrackState(known), 2 * (size,)
    box = (place[0] - size / 2, place[1] - size / 2, place[0] + size / 2, place[1] + size / 2)
    one.new_detections = [(n * DT, *place, *box, size**2, *place) for n in range(steps)]
    return one


def come(number: int, size: float, top: float, bottom: float, left: float, right: float) -> np.ndarray:
    """So many tracks that came evenly in a part of the picture."""
    chance = np.random.default_rng(0)
    rows, columns = chance.uniform(top, bottom, number), chance.uniform(left, right, number)
    return np.stack([np.arange(100.0, 100 + number), np.zeros(number), rows, columns, np.full(number, size)], 1)


EVERYWHERE = round(1.2 * P.clutter_rate * CLUTTER_WINDOW_S * WIDTH)
CLOSE = round(1.2 * P.clutter_density * CLUTTER_WINDOW_S * 4 * RADIUS**2)


@pytest.mark.parametrize(
    ("others", "size", "many"),
    [
        (come(EVERYWHERE, 0.05, 0, 1, 0, WIDTH), 0.05, True),
        (come(EVERYWHERE, 0.05, 0, 1, 0, WIDTH), 0.1, False),
        (come(EVERYWHERE, 0.05, 0, 1, 0, WIDTH), 0.025, False),
        (come(EVERYWHERE // 2, 0.05, 0, 1, 0, WIDTH), 0.05, False),
        (come(CLOSE, 0.05, 0.3, 0.7, 0.6, 1.0), 0.05, True),
        (come(CLOSE, 0.05, 0.3, 0.7, 1.2, 1.6), 0.05, False),
    ],
    ids=["everywhere", "it is larger", "it is smaller", "half as many", "close to it", "close together elsewhere"],
)
def test_many_of_a_size(others: np.ndarray, size: float, many: bool) -> None:
    one = track(0, (0.5, 0.8), size)
    assert is_particle_clutter(one, others, 60.0, WIDTH, P) is many
    assert not is_particle_clutter(one, others, 60.0, WIDTH, P.model_copy(update={"min_travel_sizes": 0.0}))


@pytest.mark.parametrize(("gone", "known"), [(0.0, True), (0.5, False)])
def test_an_object_that_goes_to_and_fro_is_one_where_nothing_else_came_and_went(gone: float, known: bool) -> None:
    """It is asked a second after it became one, in the very step in which it is seen."""
    one = track(0, (0.5, 0.8), 0.2, steps=26, known=True)
    swaying = [0.8 + 0.12 * (n % 10 < 5) for n in range(26)]
    one.new_detections = [
        (row[0], 0.5, at, 0.4, at - 0.1, 0.6, at + 0.1, 0.04, 0.5, at)
        for row, at in zip(one.new_detections, swaying, strict=True)
    ]
    one.confirmed_at = 0.0
    where, none = empty_clutter_map(50, 80) + np.float32(gone), np.zeros((0, BIRTH))
    assert revoke_confirmation(one, np.ones((56, 100), np.float32), STILL, one.last_seen, DT, P)
    confirm([one], [], where, STILL, none, lambda: 0.4, one.last_seen, 60.0, DT, WIDTH, P)
    assert one.is_object is known


@pytest.mark.slow
def test_a_thing_that_crosses_snow_is_found_and_the_flakes_are_not() -> None:
    """It crosses from 4 s to 8 s, as large as three flakes."""
    fps, count = 25, 200
    still = np.asarray(ground().permute(1, 2, 0).numpy())
    frames = [frame.copy() for frame in snow(still, np.random.default_rng(3), count)]
    for n in range(100, count):
        at = round(16 * (n - 100) / 100 * SIZE[1]), round(16 * 0.35 * SIZE[0])
        cv2.circle(frames[n], at, 16 * SIZE[0] // 12, (0.1, 0.1, 0.5), -1, cv2.LINE_AA, 4)
    film = torch.stack([torch.from_numpy(frame) for frame in frames]).permute(0, 3, 1, 2).clamp(0, 1)
    counts = []
    for options in ({}, {"tracking.clutter_rate": 1e9, "tracking.clutter_density": 1e9}):
        model = ndtorch.load("foreground", size=SIZE, fps=fps, **options)
        with torch.inference_mode():
            _, state = model(film)
        objects = model.objects(state)
        assert any(one.heading[0] > 0.6 * SIZE[1] for one in objects)
        counts.append(len(objects))
    assert 10 * counts[0] < counts[1]
