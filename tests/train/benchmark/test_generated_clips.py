"""Generated video: the clips are what their truth says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch_train.benchmark.generated_clips import DIRECTIONS, SPLIT_SEEDS, Painter, boxes_of, clip_file, draw_clip
from ndtorch_train.benchmark.mot import Box, TrueBox

# The first one-object clip of the tune split at 12.5 a second whose frames are the smallest.
ONE = next(clip for n in range(50) if (clip := draw_clip("tune", n, 1, 12.5)).size == (180, 320))


def test_clips_repeat_and_splits_and_cells_differ() -> None:
    assert draw_clip("tune", 3, 2, 25.0) == draw_clip("tune", 3, 2, 25.0)
    clips = [draw_clip(split, n, c, f) for split in SPLIT_SEEDS for n in (0, 1) for c in (1, 2) for f in (12.5, 25.0)]
    assert len({clip.movers for clip in clips}) == len(clips)
    frames = [next(Painter(ONE).frames()) for _ in range(2)]
    assert np.array_equal(*frames)


@pytest.mark.parametrize("number", range(6))
def test_objects_move_as_their_direction_says(number: int) -> None:
    clip = draw_clip("tune", number, 2, 25.0)
    places: dict[int, list[Box]] = {}
    for frame in boxes_of(clip):
        for one in frame.objects:
            assert isinstance(one, TrueBox)
            assert one.identity is not None
            places.setdefault(one.identity, []).append(one.box)
    assert sorted(places) == [0, 1]
    for number, boxes in places.items():
        right, down = boxes[-1].left - boxes[0].left, boxes[-1].top - boxes[0].top
        axis = {"left": -right, "right": right, "down": down, "up": -down}
        assert clip.movers[number].direction == max(DIRECTIONS, key=lambda d: axis[d])
        assert len(boxes) >= 25


def test_the_object_is_drawn_in_its_true_box() -> None:
    empty = list(Painter(replace(ONE, movers=())).frames())
    for n, (frame, truth) in enumerate(zip(Painter(ONE).frames(), boxes_of(ONE), strict=True)):
        if not truth.objects or n % 10:
            continue
        rows, columns = np.nonzero(np.abs(frame.astype(int) - empty[n]).max(-1) > 40)
        box = truth.objects[0].box
        assert rows.mean() == pytest.approx((box.top + box.bottom) / 2, abs=0.12 * 180)
        assert columns.mean() == pytest.approx((box.left + box.right) / 2, abs=0.08 * 320)


def test_clips_without_objects_change_in_light_only() -> None:
    clip = draw_clip("tune", 0, 0, 12.5)
    assert clip.movers == ()
    assert clip.steps
    assert clip.flicker
    assert [frame.objects for frame in boxes_of(clip)] == [[]] * clip.frames


def test_a_clip_is_encoded_once(tmp_path: Path) -> None:
    path = clip_file(replace(ONE, seconds=0.4), tmp_path)
    capture = cv2.VideoCapture(str(path))
    assert (capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)) == (12.5, 5)
    before = path.stat().st_mtime_ns
    assert clip_file(replace(ONE, seconds=0.4), tmp_path).stat().st_mtime_ns == before
