"""Clips that are drawn, and labelled video: both kinds of truth are read, and scores are of what was reported."""

from __future__ import annotations

import csv
from dataclasses import replace
from importlib.util import find_spec
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch_train.benchmark.dish_clips import DISH, DISHES, RADIUS, SIZE, dish_frames, draw_animals
from ndtorch_train.benchmark.dish_clips import true_boxes as dish_boxes
from ndtorch_train.benchmark.foreground import measure, negative_clip
from ndtorch_train.benchmark.generated_clips import DIRECTIONS, SPLIT_SEEDS, Painter, boxes_of, clip_file, draw_clip
from ndtorch_train.benchmark.mot import (
    Box,
    Hypothesis,
    PackedMask,
    Pixels,
    TrackerOutput,
    TrueBox,
    hota,
    mot_score,
    overlap_ratios,
    overlapping,
    read_boxes,
    read_clip,
)
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


FRAMES, SHAPE, SIDE = 40, (96, 128), 16


def place(n: int) -> tuple[int, int]:
    """Left and top of a square that moves to the right."""
    return 2 + 2 * n, 40


def write_clip(folder: Path, kind: str) -> Path:
    folder.mkdir()
    rng = np.random.default_rng(1)
    ground = rng.integers(90, 130, (*SHAPE, 3), dtype=np.uint8)
    film = cv2.VideoWriter(str(folder / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, SHAPE[::-1])
    masks = cv2.VideoWriter(str(folder / "masks.mkv"), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, SHAPE[::-1])
    rows = []
    for n in range(FRAMES):
        left, top = place(n)
        frame, mask = ground.copy(), np.zeros((*SHAPE, 3), np.uint8)
        if n >= 8:
            frame[top : top + SIDE, left : left + SIDE] = (20, 30, 230)
            mask[top : top + SIDE, left : left + SIDE] = 255
            rows.append(f"{n + 1},7,{left},{top},{SIDE},{SIDE},1,0,0,0")
        film.write(frame)
        masks.write(mask)
    film.release()
    masks.release()
    if kind == "boxes":
        (folder / "masks.mkv").unlink()
        (folder / "gt.txt").write_text("\n".join(rows))
    return folder


def hypothesis(track: int, column: float, row: float) -> Hypothesis:
    return Hypothesis(track, (column, row), Box(column - 8, row - 8, column + 8, row + 8))


def truth_file(path: Path, *things: tuple[int, float]) -> Path:
    """Ten frames of things at fixed columns, each with its number, at row 50; they move by a pixel a frame."""
    lines = [f"{n + 1},{name},{at + n},42,16,16,1" for n in range(10) for name, at in things]
    path.write_text("\n".join(lines))
    return path


def test_places_identities_switches_and_fragments(tmp_path: Path) -> None:
    file = truth_file(tmp_path / "gt.txt", (1, 0.0), (2, 60.0))
    right = [[hypothesis(5, n + 8, 50), hypothesis(6, n + 68, 50)] for n in range(10)]
    whole = mot_score(TrackerOutput(right), read_boxes(file), 25.0, False)
    assert (whole.precision, whole.recall, whole.idf1, whole.mota, whole.count_error) == (1, 1, 1, 1, 0)
    assert (whole.switches, whole.fragments) == (0, 0)
    swapped = right[:6] + [[hypothesis(6, n + 8, 50), hypothesis(5, n + 68, 50)] for n in range(6, 10)]
    other = mot_score(TrackerOutput(swapped), read_boxes(file), 25.0, False)
    assert (other.f, other.switches, other.idf1, other.mota) == (1.0, 2, pytest.approx(0.6), pytest.approx(0.9))
    lost = right[:4] + [[frame[0], hypothesis(9, 120, 90)] for frame in right[4:6]] + right[6:]
    third = mot_score(TrackerOutput(lost), read_boxes(file), 25.0, False)
    assert (third.precision, third.recall, third.fragments) == (pytest.approx(0.9), pytest.approx(0.9), 1)
    assert third.count_error == 0
    alone = mot_score(TrackerOutput([frame[:1] for frame in right]), read_boxes(file), 25.0, False)
    assert (alone.recall, alone.count_error) == (0.5, 1)


def test_hota_of_an_object_whose_second_box_is_another_track_and_overlaps_by_half() -> None:
    true, seen = Box(0, 0, 10, 10), [Box(0, 0, 10, 10), Box(0, 0, 10, 5)]
    frames = [(np.array([7]), np.array([n]), overlap_ratios([true], [box])) for n, box in enumerate(seen)]
    # Up to .5 both boxes are right: DetA 1, and each of the two pairs shares 1 frame of 2. Above it one is right, one
    # missed and one false: DetA 1/3.
    assert hota(frames) == pytest.approx((10 * (1 * 1 / 2) ** 0.5 + 9 * (1 / 3 * 1 / 2) ** 0.5) / 19)
    assert hota(frames[:1]) == 1
    assert hota([(np.array([7]), np.array([], int), overlap_ratios([true], []))]) == 0


def test_main_direction_and_what_is_false_where_nothing_is(tmp_path: Path) -> None:
    lines = [f"{n + 1},1,{4 * n},42,16,16,1" for n in range(10)]
    (tmp_path / "gt.txt").write_text("\n".join(lines))
    toward = [[hypothesis(1, 4 * n + 8, 50)] for n in range(10)]
    assert mot_score(TrackerOutput(toward), read_boxes(tmp_path / "gt.txt"), 25.0, False).direction == 1
    turned = [[hypothesis(1, 4 * n + 8, 50 + 0.1 * n)] if n < 9 else [hypothesis(1, 5, 50)] for n in range(10)]
    assert mot_score(TrackerOutput(turned), read_boxes(tmp_path / "gt.txt"), 25.0, False).direction == 0
    quiet = mot_score(
        TrackerOutput([[hypothesis(1, 8, 50)]] * 20 + [[hypothesis(2, 8, 50)]] * 5), iter(()), 25.0, False
    )
    assert quiet.false_per_minute == pytest.approx(120)


def test_masks_are_compared_where_they_count(tmp_path: Path) -> None:
    labelled = read_clip(write_clip(tmp_path / "clip", "masks"))
    truth = list(labelled.truth())
    assert len(truth) == FRAMES
    masks = []
    for frame in truth:
        assert frame.moving is not None
        masks.append(PackedMask(frame.moving))
    assert all((packed.mask() == frame.moving).all() for packed, frame in zip(masks, truth, strict=True))
    hypotheses = [[hypothesis(0, place(n)[0] + 8, 48)] if n >= 8 else [] for n in range(FRAMES)]
    whole = mot_score(TrackerOutput(hypotheses, masks), truth, 25.0, True)
    assert (whole.f, whole.mask_f, whole.idf1, whole.false_per_minute) == (1, 1, None, 0)
    none = [PackedMask(np.zeros(SHAPE, bool))] * FRAMES
    assert mot_score(TrackerOutput(hypotheses, none), truth, 25.0, True).mask_f == 0


@pytest.mark.parametrize("kind", ["boxes", "masks"])
def test_model_and_peers_are_in_one_table(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("norfair")
    pytest.importorskip("supervision")
    write_clip(tmp_path / "square", kind)
    methods = ["foreground", "mog2-norfair", *(["knn-bytetrack"] if find_spec("trackers") else [])]
    out = tmp_path / "out"
    words = ["benchmark", "foreground", str(tmp_path), "--jobs", "1", "--out", str(out), "--methods", *methods]
    assert main(words) == 0
    with (out / "foreground.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["method"] for row in rows] == methods
    assert {row["clip"] for row in rows} == {"square"}
    for row in rows:
        assert float(row["f"]) > (0.5 if row["method"] != "foreground" else -1)
        assert (row["idf1"] == "") == (kind == "masks")
        assert float(row["ms_per_frame"]) > 0
    assert "square" in (out / "report.html").read_text(encoding="utf-8")


def test_generated_clips_have_a_row_for_each_number_of_objects(tmp_path: Path) -> None:
    words = ["--generated", "1", "--counts", "0", "1", "--fps", "12.5", "--methods", "foreground", "--jobs", "1"]
    assert main(["benchmark", "foreground", *words, "--out", str(tmp_path)]) == 0
    with (tmp_path / "foreground.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["clip"] for row in rows] == ["0 objects, 12.5/s, 0", "1 objects, 12.5/s, 0"]
    assert float(rows[1]["recall"]) > 0.5
