"""Clips that are hard for background subtraction: what is drawn is where the truth says."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from ndtorch_train.benchmark.dish_clips import DISH, DISHES, RADIUS, SIZE, dish_frames, draw_animals
from ndtorch_train.benchmark.dish_clips import true_boxes as dish_boxes
from ndtorch_train.benchmark.mot import Box, Hypothesis, overlapping
from ndtorch_train.benchmark.street_clips import StreetFrames, true_boxes


@pytest.mark.parametrize("kind", ["dark cars", "insects"])
def test_what_is_darker_than_the_ground_is_in_the_boxes(kind: str) -> None:
    frames = np.stack(list(islice(StreetFrames(kind, 3), 0, 90, 10))).astype(int)
    truth = list(islice(true_boxes(kind, 3), 0, 90, 10))
    darker = (np.median(frames, 0) - frames > 60).all(-1)
    assert darker.sum() > 500
    for marked, frame in zip(darker, truth, strict=True):
        for obj in frame.objects:
            left, top, right, bottom = (round(side) for side in obj.box)  # type: ignore[attr-defined]
            marked[max(0, top - 1) : bottom + 2, max(0, left - 1) : right + 2] = False
        # Of cars that come in, less than half is no object yet.
        assert marked[:, 14:-14].sum() < 20


def test_boxes_are_right_that_share_half_of_their_union_and_each_once() -> None:
    true = [Box(0, 0, 10, 10), Box(20, 0, 30, 10)]
    seen = [Box(0, 0, 10, 5), Box(0, 0, 10, 4.9), Box(20, 0, 30, 4.9), Box(0, 0, 10, 9)]
    assert overlapping(true, [Hypothesis(n, (0, 0), box) for n, box in enumerate(seen)]) == 1
    assert overlapping(true, []) == 0


@pytest.mark.parametrize("kind", ["2 of 15-30 px", "12 of 8-14 px"])
def test_insects_in_a_dish_are_dark_in_their_boxes_and_rest(kind: str) -> None:
    frames = np.stack(list(islice(dish_frames(kind, 3), 0, 30, 10))).astype(int)
    row, column = np.indices(SIZE)
    inside = np.hypot(row - DISH[0], column - DISH[1]) < RADIUS - 12  # without the rim
    dark = (frames.mean(-1) < 110) & inside
    for marked, frame in zip(dark, islice(dish_boxes(kind, 3), 0, 30, 10), strict=True):
        assert len(frame.objects) == DISHES[kind][0]
        for obj in frame.objects:
            left, top, right, bottom = (round(side) for side in obj.box)  # type: ignore[attr-defined]
            marked[max(0, top - 1) : bottom + 2, max(0, left - 1) : right + 2] = False
        assert not marked.any()
    steps = np.stack([np.abs(np.diff(one.path[:, :2], axis=0)).max(1) for one in draw_animals(kind, 3)])
    assert (steps == 0).any()
    assert all(DISHES[kind][1][0] <= one.length <= DISHES[kind][1][1] for one in draw_animals(kind, 3))
