"""Clips that are drawn: objects, streets and dishes."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_train.benchmark.dish_clips import DISH, DISHES, RADIUS, SIZE, dish_frames, draw_animals
from ndtorch_train.benchmark.dish_clips import true_boxes as dish_boxes
from ndtorch_train.benchmark.foreground import measure, negative_clip
from ndtorch_train.benchmark.generated_clips import DIRECTIONS, SPLIT_SEEDS, Painter, boxes_of, clip_file, draw_clip
from ndtorch_train.benchmark.mot import Box, Pixels, TrueBox, overlap_ratios, overlapping
from ndtorch_train.benchmark.negative_clips import FPS, KINDS, still_image
from ndtorch_train.benchmark.street_clips import StreetFrames, true_boxes

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
    assert overlapping(overlap_ratios(true, seen)) == 1
    assert overlapping(overlap_ratios(true, [])) == 0


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


@pytest.fixture
def still() -> Pixels:
    chance = np.random.default_rng(2)
    coarse = chance.integers(40, 200, (6, 8, 3), dtype=np.uint8)
    return np.asarray(cv2.resize(coarse, (128, 96), interpolation=cv2.INTER_CUBIC))


@pytest.mark.parametrize("kind", KINDS)
def test_a_clip_is_the_same_every_time_and_changes_with_time(still: Pixels, kind: str) -> None:
    labelled = negative_clip(kind, still, 1.0, "tune")
    frames, again = list(labelled.clip.frames), list(labelled.clip.frames)
    assert len(frames) == FPS
    assert all(frame.shape == (96, 128, 3) and frame.dtype == np.uint8 for frame in frames)
    assert all(np.array_equal(a, b) for a, b in zip(frames, again, strict=True))
    assert not np.array_equal(frames[3], frames[9])
    assert not np.array_equal(frames[3], next(iter(negative_clip(kind, still, 1.0, "test").clip.frames)))
    assert list(labelled.truth()) == []


def test_what_is_reported_there_is_false(still: Pixels, tmp_path: Path) -> None:
    (row,) = measure("foreground", "rain", lambda out: negative_clip("rain", still, 2.0, "tune"), 0, tmp_path)
    assert (row["recall"], row["idf1"], row["mask_f"]) == (0, None, None)
    assert row["false_per_minute"] >= 0


def test_a_still_image_is_an_image_or_the_median_of_a_video(still: Pixels, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "still.png"), still)
    assert np.array_equal(still_image(tmp_path / "still.png"), still)
    film = cv2.VideoWriter(str(tmp_path / "clip.mkv"), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (128, 96))
    for n in range(5):
        frame = still.copy()
        frame[10:20, 20 * n : 20 * n + 10] = 255
        film.write(frame)
    film.release()
    assert np.abs(still_image(tmp_path / "clip.mkv").astype(int) - still).max() <= 3
    (tmp_path / "text").write_text("words")
    for path, message in (
        (tmp_path / "none", "no such file"),
        (tmp_path / "text", "is not an image or video of 32 x 32"),
    ):
        with pytest.raises(InputError, match=message):
            still_image(path)
