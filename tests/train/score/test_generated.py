"""Generated video: the clips are what their truth says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ndtorch_train.score.video_clips import DIRECTIONS, SPLIT_SEEDS, draw_clip, truth
from ndtorch_train.score.video_paint import Painter

# The first one-object clip of the tune split at 12.5 a second whose frames are the smallest.
ONE = next(clip for n in range(50) if (clip := draw_clip("tune", n, 1, 12.5)).size == (180, 320))


def test_clips_repeat_and_splits_and_cells_differ() -> None:
    assert draw_clip("tune", 3, 2, 25.0) == draw_clip("tune", 3, 2, 25.0)
    clips = [draw_clip(split, n, c, f) for split in SPLIT_SEEDS for n in (0, 1) for c in (1, 2) for f in (12.5, 25.0)]
    assert len({clip.movers for clip in clips}) == len(clips)
    frames = [next(Painter(ONE).frames()) for _ in range(2)]
    assert np.array_equal(*frames)


@pytest.mark.parametrize("number", range(6))
def test_objects_move_as_the_truth_says(number: int) -> None:
    clip = draw_clip("tune", number, 2, 25.0)
    for thing in truth(clip)["objects"]:
        first, last = np.array(thing["places"][0]), np.array(thing["places"][-1])
        down, right = (last - first) * [1, clip.size[1] / clip.size[0]]
        axis = {"left": -right, "right": right, "down": down, "up": -down}
        assert thing["direction"] == max(DIRECTIONS, key=lambda d: axis[d])
        assert len(thing["times"]) >= 12


def test_the_object_is_drawn_where_the_truth_says() -> None:
    known = truth(ONE)["objects"][0]
    empty = list(Painter(replace(ONE, movers=())).frames())
    for n, frame in enumerate(Painter(ONE).frames()):
        time = round(n / ONE.fps, 2)
        if time not in known["times"] or n % 10:
            continue
        row, column = known["places"][known["times"].index(time)]
        changed = np.abs(frame.astype(int) - empty[n]).max(-1) > 40
        rows, columns = np.nonzero(changed)
        assert rows.mean() / 180 == pytest.approx(row, abs=0.12)
        assert columns.mean() / 320 == pytest.approx(column, abs=0.08)


def test_clips_without_objects_change_in_light_only() -> None:
    clip = draw_clip("tune", 0, 0, 12.5)
    assert clip.movers == ()
    assert clip.steps
    assert clip.flicker
    assert truth(clip)["count_over_time"] == [0] * 80
