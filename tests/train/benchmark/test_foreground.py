"""The benchmark on labelled clips: scores of known reports, SORT, and a row of a clip."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch_train.benchmark.foreground import Report, Sort, foreground_benchmark, read_clip, score

SIZE, STEPS = (96, 128), 60


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip of one dark square that crosses from frame 20 on, with its boxes and with its masks."""
    root = tmp_path_factory.mktemp("clips")
    rng = np.random.default_rng(1)
    for name in ("boxes", "masks"):
        place = root / name
        place.mkdir()
        ground = rng.integers(120, 136, (*SIZE, 3)).astype(np.uint8)
        film = cv2.VideoWriter(str(place / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 25, SIZE[::-1])
        masks = cv2.VideoWriter(str(place / "masks.mkv"), cv2.VideoWriter.fourcc(*"FFV1"), 25, SIZE[::-1])
        rows = []
        for n in range(STEPS):
            image, mask, left = ground.copy(), np.zeros((*SIZE, 3), np.uint8), 2 * (n - 20)
            if n >= 20:
                image[40:56, left : left + 16], mask[40:56, left : left + 16] = 20, 255
                rows.append(f"{n + 1},1,{left},40,16,16,1,-1,-1,-1")
            film.write(image)
            masks.write(mask)
        film.release()
        masks.release()
        if name == "boxes":
            (place / "masks.mkv").unlink()
            (place / "gt.txt").write_text("\n".join(rows))
    return root


def reported(shift: float, track: int = 7) -> Report:
    """What moves, so many pixels beside where it is."""
    rows = [np.zeros((0, 7))] * 20
    for n in range(20, STEPS):
        left = 2.0 * (n - 20) + shift
        rows.append(np.array([[track, left + 8, 48, left, 40, left + 16, 56]]))
    return Report(rows)


@pytest.mark.parametrize(("shift", "f", "boxes"), [(0.0, 1.0, 1.0), (6.0, 1.0, 0.0), (9.0, 0.0, 0.0)])
def test_a_position_is_right_inside_a_box_and_a_box_by_half_of_the_union(
    folder: Path, shift: float, f: float, boxes: float
) -> None:
    row = score(reported(shift), read_clip(folder / "boxes"))
    assert (row["f"], row["box_f"], row["idf1"], row["count_error"]) == (f, boxes, f, 0)


def test_a_track_that_changes_its_number_halves_idf1_and_one_that_is_missed_counts(folder: Path) -> None:
    clip, report = read_clip(folder / "boxes"), reported(0.0)
    for n in range(40, STEPS):
        report.rows[n][:, 0] = 8
    assert score(report, clip)["idf1"] == 0.5
    report.rows[30:] = [np.zeros((0, 7))] * 30
    row = score(report, clip)
    assert (row["precision"], row["recall"], row["count_error"]) == (1, 0.25, 0.5)


def test_blobs_hold_positions_within_three_pixels_and_masks_are_compared(folder: Path) -> None:
    clip = read_clip(folder / "masks")
    assert (score(reported(10.0), clip)["f"], score(reported(12.0), clip)["f"]) == (1, 0)
    report = reported(0.0)
    report.masks = [np.zeros(SIZE, bool) for _ in range(STEPS)]
    for n in range(20, STEPS):
        report.masks[n][40:48, 2 * (n - 20) : 2 * (n - 20) + 16] = True
    assert score(report, clip)["mask_f"] == pytest.approx(2 / 3)


def test_sort_keeps_two_that_cross_apart() -> None:
    sort, numbers = Sort(25.0), []
    for n in range(60):
        boxes = np.array([[2.0 * n, 10, 2.0 * n + 20, 30], [120 - 2.0 * n, 40, 140 - 2.0 * n, 60]])
        found, _ = sort(boxes)
        numbers.append(found.tolist())
    assert numbers[0] == []
    assert numbers[-1] == [0, 1]


def test_a_peer_finds_the_square(folder: Path, tmp_path: Path) -> None:
    benchmark = foreground_benchmark(["mog2-sort"], folder, "tune")
    rows = [row for task in benchmark.tasks for row in task.work(tmp_path)]
    assert [row["clip"] for row in rows] == ["boxes", "masks"]
    assert min(row["f"] for row in rows) > 0.6
    assert benchmark.summary(rows)[0]["f"] == pytest.approx(np.mean([row["f"] for row in rows]))
    with pytest.raises(InputError, match="methods must be"):
        foreground_benchmark(["mog2-norfair"], folder, "tune")
    with pytest.raises(InputError, match="no folder with a clip"):
        foreground_benchmark(["mog2-sort"], tmp_path, "tune")
