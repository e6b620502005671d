"""Small things where nothing larger is near are tracks, and pieces elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.tracking.blobs import connected_components, drop_fragments
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.track import Track
from tests.foreground.passing_scenes import SIZE, ground

P = TrackingParams()
LEAST = P.min_area_ratio * 160 * 100


def seen(row: float, column: float, pixels: float) -> Track:
    one = Track.begin(0, 0.0, np.array([row, column]))
    one.extent = 2 * (0.02,)
    one.new_detections.append(
        (0.0, row, column, row - 0.01, column - 0.01, row + 0.01, column + 0.01, pixels, row, column)
    )
    return one


def picture(gap: int) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """A large square, and a small one so many pixels beside it."""
    figure = np.zeros((100, 160), bool)
    figure[40:60, 20:40] = True
    figure[50:52, 40 + gap : 43 + gap] = True
    return figure


@pytest.mark.parametrize(("gap", "left"), [(18, 1), (21, 2)])
def test_a_small_region_is_left_out_near_a_larger_one(gap: int, left: int) -> None:
    regions = drop_fragments(connected_components(picture(gap), 4, 2), [], 0.0, P)
    assert len(regions.areas) == len(regions.boxes) == left
    assert regions.labels.max() == left
    for r, (top, first, bottom, last) in enumerate(regions.boxes.tolist()):
        assert (regions.labels[top:bottom, first:last] == r + 1).all()


@pytest.mark.parametrize(("away", "pixels", "left"), [(0.1, 2.0, 0), (0.1, 0.5, 1), (0.3, 2.0, 1)])
def test_a_small_region_is_left_out_where_a_larger_track_is_expected(away: float, pixels: float, left: int) -> None:
    figure = np.zeros((100, 160), bool)
    figure[50:52, 80:83] = True
    there = [seen(0.5, 0.8 + away, pixels * LEAST / 100**2)]
    assert len(drop_fragments(connected_components(figure, 4, 2), there, 0.0, P).areas) == left


@pytest.mark.parametrize(("step", "objects"), [(3, 1), (0, 0)], ids=["crosses", "stays"])
def test_a_thing_of_five_rows_that_crosses_is_an_object(step: int, objects: int) -> None:
    """It has 35 of 89 600 pixels."""
    still = (ground() * 255).to(torch.uint8).repeat_interleave(2, 1).repeat_interleave(2, 2)
    frames = still.repeat(90, 1, 1, 1)
    for n in range(30, 90):
        left = 40 + step * (n - 30)
        frames[n, :, 100:105, left : left + 7] = 245
    for options, found in (({}, objects), ({"tracking.min_area_isolated_ratio": P.min_area_ratio}, 0)):
        model = ndtorch.load("foreground", size=(2 * SIZE[0], 2 * SIZE[1]), fps=25.0, **options)
        with torch.inference_mode():
            _, state = model(frames)
        assert len(model.objects(state)) == found
