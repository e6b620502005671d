"""What stands from the first frame on is reported from there on, once it has left."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.binding import BoundObject
from ndtorch.tracking.ghosts import trace_back
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.track import PIXELS, Track, TrackState

FPS, SIZE = 12.5, (72, 96)


def objects_of(leaves: float, enters: float | None = None) -> list[BoundObject]:
    """Of 9 s with a square of 12 pixels: it leaves its place at a time, to which it may have come at another one."""
    ground = 105 + np.random.default_rng(0).normal(0, 1, (round(9 * FPS), *SIZE, 3))
    for n, image in enumerate(ground):
        time = n / FPS
        column = 14 + 24 * max(0.0, time - leaves) - 24 * max(0.0, (enters or 0.0) - time)
        image[30:42, max(0, round(column)) : max(0, round(column) + 12)] = (200, 60, 50)
    frames = torch.from_numpy(ground.astype(np.uint8)).permute(0, 3, 1, 2)
    model = ndtorch.load("foreground", size=SIZE, fps=FPS)
    return list(model.objects(model(frames)[1]))


def test_what_stood_from_the_first_frame_on_is_at_its_place_in_every_frame() -> None:
    [found] = objects_of(leaves=5.0)
    times = np.array([time for time, _, _ in found.path])
    assert times[0] < 1 / FPS
    np.testing.assert_allclose(np.diff(times), 1 / FPS, atol=1e-6)
    left, top, right, bottom = np.array(found.boxes)[times < 4.9].T
    inside = (np.minimum(right, 26) - np.maximum(left, 14)) * (np.minimum(bottom, 42) - np.maximum(top, 30))
    assert (inside > (144 + (right - left) * (bottom - top) - inside) / 2).all()  # half of their union
    assert found.first_seen == times[0]


def test_what_came_in_before_it_stood_was_nowhere_before() -> None:
    found = objects_of(leaves=7.0, enters=3.0)
    assert min(time for one in found for time, _, _ in one.path) > 1.8


@pytest.mark.parametrize("share", [0.0, 0.45, 0.55, 1.0])
def test_a_ghost_is_traced_to_the_track_that_looks_more_like_it_than_like_the_ground(share: float) -> None:
    """What leaves is measured together with the ground that it uncovers: that share of its mean color is its own."""
    was, now, place = np.array((0.2, 0.1, 0.1)), np.array((0.8, 0.8, 0.7)), (0.3, 0.3)
    one = Track.begin(4, 5.0, np.array(place))
    one.state, one.extent, one.passed_at = TrackState.CONFIRMED, 2 * (0.1,), -9.0
    one.color = share * was + (1 - share) * now
    one.new_detections.append((5.0, *place, 0.25, 0.25, 0.35, 0.35, 0.01, *place))
    ghost = np.array([(5.5, *place, 0.25, 0.25, 0.35, 0.35, 0.01, -1, *was, *now)])
    [traced] = trace_back(ghost, [one], 0.0, 6.0, TrackingParams())
    assert traced[8] == (4 if share > 0.5 else -1)
    assert (one.waited[PIXELS] > 0) == (share > 0.5)


@pytest.mark.parametrize(("passed", "given"), [(-9.0, 4), (0.5, -1)])
def test_a_part_of_a_ghost_is_enough_where_no_object_passed(passed: float, given: int) -> None:
    was, now, place = np.array((0.2, 0.1, 0.1)), np.array((0.8, 0.8, 0.7)), (0.3, 0.3)
    one = Track.begin(4, 5.0, place)
    one.state, one.extent, one.passed_at, one.color = TrackState.CONFIRMED, 2 * (0.1,), passed, was
    one.new_detections.append((5.0, *place, 0.25, 0.25, 0.35, 0.35, 0.01, *place))
    ghost = np.array([(5.5, *place, 0.25, 0.25, 0.35, 0.3, 0.002, -1, *was, *now)])
    [traced] = trace_back(ghost, [one], 0.0, 6.0, TrackingParams())
    assert traced[8] == given
