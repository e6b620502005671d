"""Tracks: where they are expected, which blobs they get, and which pixels are theirs."""

from __future__ import annotations

import numpy as np
import pytest

from ndtorch.tracking.association import Association, assign_unmatched, share_blob
from ndtorch.tracking.blobs import Blobs
from ndtorch.tracking.masks import Detection, share_pixels
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.track import PIXELS, PLACE, Track, TrackState
from ndtorch.tracking.tracker import add_detection


def track(number: int, time: float, row: float, column: float, extent: float = 0.1, pixels: float = 0.01) -> Track:
    """An object with one detection."""
    one = Track.begin(number, time, np.array([row, column]))
    one.state, one.extent = TrackState.CONFIRMED, 2 * (extent,)
    one.new_detections.append((time, *[0.0] * 6, pixels, row, column))
    return one


@pytest.mark.parametrize(
    ("lost_for", "away", "found"), [(0.1, 0.1, True), (0.1, 0.15, False), (1.5, 0.2, True), (1.5, 0.3, False)]
)
def test_what_was_lost_for_longer_is_looked_for_farther_away(lost_for: float, away: float, found: bool) -> None:
    """A stationary object of a tenth of the height: as far as its own size, and as much again every second."""
    params = TrackingParams(gate_sizes=1.0, color_cost=0.0)
    labels = np.zeros((100, 160), np.int32)
    left = round(100 * (0.3 + away)) - 5
    labels[25:35, left : left + 10] = 1
    blobs, met = Blobs(labels, np.array([[25, left, 35, left + 10]]), np.array([100])), Association({0: []}, {})
    image = np.zeros((3, 100, 160), np.float32)
    assign_unmatched([track(1, 5.0, 0.3, 0.3)], met, blobs, image, 5.0 + lost_for, params)
    assert met.tracks == {0: [0] if found else []}


@pytest.mark.parametrize(("age", "found"), [(2.0, True), (0.5, False)])
def test_what_merged_with_noise_for_one_frame_is_found_again(age: float, found: bool) -> None:
    """It had 100 pixels until four times as many were seen with it."""
    one = track(1, 0.0, 0.3, 0.3)
    for time, pixels in ((age - 0.12, 0.01), (age - 0.08, 0.01), (age - 0.04, 0.01), (age, 0.04)):
        one.new_detections.append((time, *[0.0] * 6, pixels, 0.3, 0.3))
    labels, met = np.zeros((100, 160), np.int32), Association({0: []}, {})
    labels[25:35, 30:40] = 1
    blobs, image = Blobs(labels, np.array([[25, 30, 35, 40]]), np.array([100])), np.zeros((3, 100, 160), np.float32)
    assign_unmatched([one], met, blobs, image, age + 0.04, TrackingParams(color_cost=0.0))
    assert met.tracks == {0: [0] if found else []}


@pytest.mark.parametrize(("pixels", "found"), [(0.04, True), (0.02, False)])
def test_what_noise_moved_away_is_looked_for_where_it_was(pixels: float, found: bool) -> None:
    """A step ago it was two of its sizes further, and as large as that noise made it."""
    one = track(1, 0.0, 0.3, 0.3)
    one.new_detections.append((1.96, *[0.0] * 6, 0.01, 0.3, 0.3))
    one.new_detections.append((2.0, *[0.0] * 6, pixels, 0.3, 0.5))
    labels, met = np.zeros((100, 160), np.int32), Association({0: []}, {})
    labels[25:35, 26:36] = 1
    blobs, image = Blobs(labels, np.array([[25, 26, 35, 36]]), np.array([100])), np.zeros((3, 100, 160), np.float32)
    assign_unmatched([one], met, blobs, image, 2.04, TrackingParams(color_cost=0.0))
    assert met.tracks == {0: [0] if found else []}


@pytest.mark.parametrize(("state", "moved"), [(TrackState.STATIONARY, False), (TrackState.CONFIRMED, True)])
def test_what_stands_stays_in_its_place_when_something_covers_it(state: TrackState, moved: bool) -> None:
    one = track(1, 0.0, 0.3, 0.3)
    one.state = state
    covered = Detection((0.3, 0.4), (0.3, 0.4), (0.1, 0.3), 0.03, np.zeros(3), np.zeros(4), 0.0, False)
    add_detection(one, 0.04, covered, 1.6, TrackingParams())
    assert (one.last[PLACE] == (0.3, 0.3)) is not moved
    assert (one.last[PIXELS] == 0.01) is not moved


@pytest.mark.parametrize(("age", "seen", "parts"), [(0.5, [2], [1]), (1.5, [1, 2], [])])
def test_a_young_object_that_meets_a_much_larger_one_was_a_part_of_it(
    age: float, seen: list[int], parts: list[int]
) -> None:
    small, large = track(1, 0.0, 0.3, 0.3, pixels=0.004), track(2, 0.0, 0.3, 0.4)
    small.new_detections.append((age, *small.new_detections[0][1:]))
    sharing = share_blob([small, large], 0.05, TrackingParams())
    assert [one.number for one in sharing.visible] == seen
    assert [one.number for one in sharing.parts] == parts


def test_two_tracks_share_a_blob_in_its_middle() -> None:
    """One is expected in the upper half, the other as far from the middle in the lower one: half of the pixels each."""
    ones = [track(number, 0.0, row, 0.3, 0.2) for number, row in enumerate((0.2, 0.4))]
    labels, masks = np.zeros((20, 20), np.int32), np.zeros((20, 20), np.int32)
    labels[2:10, 4:8] = 1
    box, image, params = np.array([2, 4, 10, 8]), np.zeros((3, 20, 20), np.float32), TrackingParams()
    share_pixels(masks, labels, 0, box, ones, 0.0, image, params)
    assert [int((masks[2:10] == name).sum()) for name in (1, 2)] == [16, 16]
    assert (masks[2:6, 4:8] == 1).all()
    # The lower one is red, and so is the image's upper half.
    ones[1].color, image[0, :6] = np.array([0.8, 0, 0]), 0.8
    share_pixels(masks, labels, 0, box, ones, 0.0, image, params)
    assert (masks[2:5, 4:8] == 2).all()
    assert (masks[7:10, 4:8] == 1).all()
    share_pixels(masks, labels, 0, box, ones, 0.0, image, TrackingParams(occlusion_color_cost=0.0))
    assert (masks[2:6, 4:8] == 1).all()


def test_a_track_is_expected_where_it_should_be() -> None:
    one = track(1, 2.0, 0.4, 0.7)
    one.velocity, one.extent = (0.1, -0.2), (0.3, 0.1)
    assert one.expected(3.0, 5.0) == pytest.approx([0.5, 0.5])
    assert one.box(3.0, 5.0) == pytest.approx([0.35, 0.45, 0.65, 0.55])
    # The prediction ends.
    assert one.box(9.0, 1.0) == pytest.approx([0.35, 0.45, 0.65, 0.55])
    assert one.size == pytest.approx(0.2)
