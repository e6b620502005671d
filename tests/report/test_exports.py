"""Exports in the source's own pixels, frame numbers and stamps, read by the programs that they are for."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.report.exports import encode, run_lengths, to_detections
from ndtorch.report.source_tracks import Placed
from ndtorch.scenes.video_writer import VideoWriter
from tests.foreground.passing_scenes import ground

SIZE = (540, 960)
SIDE, TOP, FIRST, STEP = 100, 210, 20, 12
FRAMES = 70


def picture(number: int) -> torch.Tensor:
    """A red square of 100 pixels comes in from the left in frame 20, in a picture that the model sees reduced."""
    wide = torch.nn.functional.interpolate(ground()[None], SIZE, mode="bilinear")[0]
    if number >= FIRST:
        left = STEP * (number - FIRST)
        wide[:, TOP : TOP + SIDE, left : left + SIDE] = torch.tensor([0.8, 0.2, 0.2])[:, None, None]
    return (wide * 255).byte()


def true_box(frame: int) -> tuple[int, int, int, int]:
    """Left, top, width and height in the frame of that number, from 1."""
    return STEP * (frame - 1 - FIRST), TOP, SIDE, SIDE


def overlap(first: np.ndarray, second: tuple[int, int, int, int]) -> float:
    """Intersection over union."""
    sides = [min(first[k] + first[k + 2], second[k] + second[k + 2]) - max(first[k], second[k]) for k in (0, 1)]
    both = max(0.0, sides[0]) * max(0.0, sides[1])
    return both / (first[2] * first[3] + second[2] * second[3] - both)


FILM = pytest.param("film", marks=pytest.mark.long)


@pytest.fixture(scope="module", params=[FILM, "quick film, from frame 5", "folder with gaps"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str] | None]:
    """A run's folder, and the names of the source's files."""
    tmp, names, more = tmp_path_factory.mktemp("exports"), None, ["--mask"]
    if request.param == "folder with gaps":
        source, names = tmp / "square", [f"img_{3 * n:04d}.png" for n in range(FRAMES)]
        source.mkdir()
        for n, name in enumerate(names):
            cv2.imwrite(str(source / name), picture(n).permute(1, 2, 0).numpy()[..., ::-1])
        (source / "._img_0000.png").write_bytes(b"\0\5\x16\7")
    else:
        source = tmp / "square.mp4"
        quick = request.param != "film"
        more += ["--start", "5"] if quick else []
        with VideoWriter(source, 40.0 if quick else 25.0, SIZE) as film:
            for n in range(FRAMES):
                film.write(picture(n))
    assert main(["bind", str(source), "--out", str(tmp / "out"), "--pictures", "2", *more]) == 0
    return tmp / "out" / "square", names


def test_boxes_fit_in_the_frames_that_a_reader_counts(run: tuple[Path, list[str] | None]) -> None:
    rows = np.loadtxt(run[0] / "mot.txt", delimiter=",")
    assert set(rows[:, 1]) == {1}
    # At first only its leading edge is seen.
    inside = [row for row in rows if FIRST + 15 < row[0] <= FRAMES]
    assert len(inside) >= FRAMES - FIRST - 17
    # The mean of two frames of the quick film is wider by one step: 100 of 112 pixels.
    assert np.mean([overlap(row[2:6], true_box(int(row[0]))) for row in inside]) > 0.8


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_pycocotools_reads_boxes_and_masks(run: tuple[Path, list[str] | None]) -> None:
    coco = pytest.importorskip("pycocotools.coco").COCO(str(run[0] / "coco.json"))
    names = [one["file_name"] for one in coco.dataset["images"]]
    assert names == run[1] or (run[1] is None and names[-1] == f"{FRAMES:06d}.jpg")
    for one in coco.dataset["annotations"]:
        mask = coco.annToMask(one)
        assert mask.shape == SIZE
        assert mask.sum() == one["area"]
        if one["image_id"] <= FIRST + 15:
            continue  # it comes in, and a mask that is moved with it is cut by the edge
        rows, columns = np.nonzero(mask)
        left, top, width, height = one["bbox"]
        assert (columns.min(), rows.min()) == pytest.approx((left, top), abs=12)
        assert (np.ptp(columns), np.ptp(rows)) == pytest.approx((width, height), abs=18)


def test_the_film_of_masks_has_every_frame_in_its_size(run: tuple[Path, list[str] | None]) -> None:
    film = cv2.VideoCapture(str(run[0] / "mask.mp4"))
    images = json.loads((run[0] / "coco.json").read_text())["images"]
    assert int(film.get(cv2.CAP_PROP_FRAME_COUNT)) == len(images)
    assert (film.get(cv2.CAP_PROP_FRAME_HEIGHT), film.get(cv2.CAP_PROP_FRAME_WIDTH)) == SIZE
    film.set(cv2.CAP_PROP_POS_FRAMES, len(images) - 10)
    left, top, width, height = true_box(images[-10]["id"])
    mask = film.read()[1][..., 0] > 127
    assert mask[top + 20 : top + height - 20, left + 20 : left + width - 20].mean() > 0.95
    assert mask.mean() < 1.5 * SIDE**2 / mask.size


def test_pandas_reads_the_tables(run: tuple[Path, list[str] | None]) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    table, text = pandas.read_parquet(run[0] / "tracks.parquet"), pandas.read_csv(run[0] / "tracks.csv")
    assert list(table.columns) == list(text.columns)
    assert np.allclose(table[["left", "top", "width", "height"]], text[["left", "top", "width", "height"]], atol=1e-3)
    rate = (table.frame.iloc[-1] - table.frame.iloc[0]) / (table.time.iloc[-1] - table.time.iloc[0])
    assert table.time.iloc[0] == pytest.approx((table.frame.iloc[0] - 1) / rate, abs=1e-3)
    assert table.speed.median() == pytest.approx(STEP * rate, rel=0.1)
    assert (table.feature_red > 0.5).all()
    mot = np.loadtxt(run[0] / "mot.txt", delimiter=",", ndmin=2)
    columns = ["frame", "track", "left", "top", "width", "height", "confidence"]
    assert np.allclose(table[columns], mot[:, :7], atol=1e-2)
    scores = [one["score"] for one in json.loads((run[0] / "coco.json").read_text())["annotations"]]
    # It crosses the frames on a straight path of several of its own sizes.
    assert 0.5 < min(scores) == pytest.approx(table.confidence.min(), abs=1e-3)


@pytest.mark.parametrize("top", [0, 3])
@pytest.mark.parametrize("left", [0, 4])
def test_run_lengths_are_those_of_pycocotools(top: int, left: int) -> None:
    masks = pytest.importorskip("pycocotools.mask")
    crop = np.random.default_rng(0).random((40, 30)) < 0.7
    crop[:, 5:8] = True
    full = np.zeros((40 + top, 30 + left), np.uint8)
    full[top:, left:] = crop
    want = masks.encode(np.asfortranarray(full))
    assert encode(run_lengths(Placed(top, left, crop), *full.shape)).encode() == want["counts"]


def test_supervision_takes_the_boxes() -> None:
    supervision = pytest.importorskip("supervision")
    assert len(supervision.Detections(**to_detections([]))) == 0
