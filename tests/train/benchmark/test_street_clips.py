"""Clips that are hard for background subtraction: what is drawn is where the truth says."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

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
