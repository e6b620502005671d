"""Labelled video: both kinds of truth are read, scores are those of what was reported, and the command's table."""

from __future__ import annotations

import csv
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch.cli.commands import main
from ndtorch_train.benchmark.mot import (
    Box,
    Hypothesis,
    PackedMask,
    TrackerOutput,
    hota,
    mot_score,
    overlap_ratios,
    read_boxes,
    read_clip,
)

FRAMES, SIZE, SIDE = 40, (96, 128), 16


def place(n: int) -> tuple[int, int]:
    """Left and top of a square that moves to the right."""
    return 2 + 2 * n, 40


def write_clip(folder: Path, kind: str) -> Path:
    folder.mkdir()
    rng = np.random.default_rng(1)
    ground = rng.integers(90, 130, (*SIZE, 3), dtype=np.uint8)
    film = cv2.VideoWriter(str(folder / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, SIZE[::-1])
    masks = cv2.VideoWriter(str(folder / "masks.mkv"), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, SIZE[::-1])
    rows = []
    for n in range(FRAMES):
        left, top = place(n)
        frame, mask = ground.copy(), np.zeros((*SIZE, 3), np.uint8)
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
    none = [PackedMask(np.zeros(SIZE, bool))] * FRAMES
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
