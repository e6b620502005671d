"""Reports, figures, exports and recordings, read by the programs that they are for."""

from __future__ import annotations

import csv
import json
import re
import signal
from dataclasses import replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from ndtorch.binding import BoundObject, Verdict, bound_objects, object_table
from ndtorch.cli.commands import main
from ndtorch.report.exports import STATES, ResponseFile
from ndtorch.report.films import EnhancedVideo, rgb
from ndtorch.report.page import Shown, Table, write_page
from ndtorch.report.plots import draw_all
from ndtorch.run.batch import bind_source
from ndtorch.run.options import BindJob
from ndtorch.run.result import MaskStore, Moment, Picture, RunResult, Trace
from ndtorch.scenes.video_writer import VideoWriter
from ndtorch.utils.signals import ended_like_ctrl_c
from tests.foreground.passing_scenes import ground

RNG = np.random.default_rng(5)


def run_of(objects: list[BoundObject], verdict: Verdict = "stable", tracks: bool = False) -> RunResult:
    table = object_table(torch.zeros(10, 10))
    model: Any = SimpleNamespace(name="published", tracks=tracks, settle=0.0, table=lambda state: table)
    source: Any = SimpleNamespace(name="clip", size=(60, 80), fps=10.0)
    objects = [replace(one, number=n) for n, one in enumerate(objects, 1)]
    weights = np.zeros((10, 10), np.float32)
    return RunResult(model, source, None, objects, verdict, 30, 0, 1.5, Trace(), weights, {}, MaskStore())


def owners() -> list[BoundObject]:
    weights = torch.zeros(10, 10)
    weights[[1, 2, 4, 6], 7] = torch.tensor([0.8, 0.6, 0.4, 0.3])
    return bound_objects(object_table(weights))


def test_a_page_is_one_file_and_fetches_nothing(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((30, 90, 3), 200, dtype=np.uint8))
    shown = [Shown(tmp_path / "a.png", "A picture", "grey"), Shown(tmp_path / "none.png", "Nothing", "not there")]
    (tmp_path / "out").mkdir()
    table = Table("A table", ["column"], [["cell"]])
    page = write_page(tmp_path / "out", "<b> & co", ["2 objects"], {"model": "published"}, [table], shown)
    text = page.read_text(encoding="utf-8")
    assert "&lt;b&gt; &amp; co" in text
    assert "Nothing" not in text
    addresses = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert len(addresses) == 2
    assert all(address.startswith("data:") for address in addresses)


def test_figures_are_drawn_of_a_long_run_a_short_one_and_an_empty_one(tmp_path: Path) -> None:
    empty, run = run_of([]), run_of(owners())
    run.outputs = Trace(np.arange(300) / 10 - 4, RNG.random((300, 10)).astype(np.float32))
    run.final_weights = np.random.default_rng(0).random((10, 10)).astype(np.float32)
    frame = RNG.integers(0, 256, (50, 60, 3), np.uint8)
    run.moments = {7: Moment(Picture(3.0, frame, frame // 4, 7), 0.5)}
    for number, result in enumerate((empty, run)):
        for path in draw_all(result, tmp_path / str(number)):
            picture = cv2.imread(str(path))
            assert picture is not None
            assert (picture < 128).mean() > 0.001


def test_a_film_has_a_frame_for_every_picture(tmp_path: Path) -> None:
    film = EnhancedVideo(tmp_path / "film.mp4", 5.0, (61, 80))
    for n in range(4):
        frame = np.full((61, 80, 3), 40 * n, np.uint8)
        film.picture(Picture(n / 5, frame, frame // 10))
    film.close()
    video = cv2.VideoCapture(str(tmp_path / "film.mp4"))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == 4


SIZE, FPS, FRAMES, PREFIX = (240, 400), 20.0, 280, 140


def true_boxes(n: int) -> dict[str, tuple[float, float, float, float]]:
    """Left, top, right and bottom in frame n, from 0: a grey block is there from the first frame and never moves; a red
    one enters, stops for four seconds and goes on; a green and a blue one cross each other's path below; then a yellow
    one fills a quarter of the view."""
    boxes = {"grey": (180.0, 20.0, 210.0, 50.0)}
    if n >= 30:
        moved = 5.0 * (min(n, 60) - 30 + max(0, n - 140))
        boxes["red"] = (moved - 30, 80.0, moved, 120.0)
    if n >= 40:
        boxes["green"] = (4.0 * (n - 40) - 70, 170.0, 4.0 * (n - 40) - 30, 210.0)
        boxes["blue"] = (430.0 - 4.0 * (n - 40) - 36, 160.0, 430.0 - 4.0 * (n - 40), 190.0)
    if n >= 190:
        boxes["yellow"] = (6.0 * (n - 190) - 200, 60.0, 6.0 * (n - 190), 180.0)
    inside = {name: (max(0.0, a), b, min(float(SIZE[1]), c), d) for name, (a, b, c, d) in boxes.items()}
    return {name: box for name, box in inside.items() if box[2] - box[0] > 1}


COLORS = {
    "red": (0.8, 0.1, 0.1),
    "green": (0.1, 0.7, 0.1),
    "blue": (0.1, 0.2, 0.8),
    "yellow": (0.8, 0.8, 0.1),
    "grey": (0.75, 0.75, 0.75),
}
MOVING = {"red": "right", "green": "right", "blue": "left", "yellow": "right"}
"""Directions of the blocks that move."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The folders of a run over the whole film and of one over its first frames."""
    tmp = tmp_path_factory.mktemp("truth")
    back = torch.nn.functional.interpolate(ground()[None], SIZE, mode="bilinear")[0]
    generator = torch.Generator().manual_seed(0)
    with VideoWriter(tmp / "blocks.mkv", FPS, SIZE) as film:
        for n in range(FRAMES):
            frame = back.clone()
            for name, box in true_boxes(n).items():
                left, top, right, bottom = map(round, box)
                frame[:, top:bottom, left:right] = torch.tensor(COLORS[name])[:, None, None]
            film.write((frame + 0.01 * torch.randn(frame.shape, generator=generator)).clamp(0, 1))
    for name, more in (("whole", []), ("prefix", ["--stop", str(PREFIX)])):
        assert main(["bind", str(tmp / "blocks.mkv"), "--out", str(tmp / name), *more]) == 0
    return tmp / "whole" / "blocks", tmp / "prefix" / "blocks"


Rows = dict[tuple[int, int], tuple[float, ...]]


def rows_of(folder: Path) -> Rows:
    """Box and number of the state of every frame and object of tracks.csv."""
    with (folder / "tracks.csv").open() as file:
        rows = list(csv.DictReader(file))
    sides = ("left", "top", "width", "height")
    return {
        (int(row["frame"]), int(row["track"])): (*(float(row[s]) for s in sides), STATES.index(row["state"]))
        for row in rows
    }


def check_same(first: Rows, second: Rows) -> None:
    assert sorted(first) == sorted(second)
    for key, row in first.items():
        assert row == pytest.approx(second[key], abs=0.01), key


def overlap(first: tuple[float, ...], second: tuple[float, ...]) -> float:
    """Intersection over union of left, top, width and height with left, top, right and bottom."""
    left, top, width, height, *_ = first
    sides = [min(left + width, second[2]) - max(left, second[0]), min(top + height, second[3]) - max(top, second[1])]
    both = max(0.0, sides[0]) * max(0.0, sides[1])
    return both / (width * height + (second[2] - second[0]) * (second[3] - second[1]) - both)


def test_rows_are_what_is_in_the_film(runs: tuple[Path, Path]) -> None:
    found = json.loads((runs[0] / "objects.json").read_text())["objects"]
    assert sorted(one["color"] for one in found) == sorted(MOVING)
    numbers, rows = {one["color"]: one["object"] for one in found}, rows_of(runs[0])
    assert {one["color"]: one["direction"] for one in found} == MOVING
    for name in MOVING:
        there = [n for n in range(FRAMES) if name in true_boxes(n)]
        seen = [n for n in there if (n + 1, numbers[name]) in rows]
        assert len(seen) > 0.9 * len(there)
        scores = [overlap(rows[n + 1, numbers[name]], true_boxes(n)[name]) for n in seen]
        assert np.median(scores) > 0.8
    states = {n: STATES[int(rows[n + 1, numbers["red"]][4])] for n in (90, 120, 150)}
    assert states == {90: "stationary", 120: "stationary", 150: "measured"}


def test_the_rows_of_a_prefix_are_a_prefix_of_the_rows(runs: tuple[Path, Path]) -> None:
    whole, prefix = map(rows_of, runs)
    check_same(prefix, {key: row for key, row in whole.items() if key[0] <= PREFIX})


def test_every_output_has_the_same_rows(runs: tuple[Path, Path]) -> None:
    folder, rows = runs[0], rows_of(runs[0])
    mot = {(int(row[0]), int(row[1])): (*row[2:6], row[9]) for row in np.loadtxt(folder / "mot.txt", delimiter=",")}
    check_same(mot, rows)
    coco = json.loads((folder / "coco.json").read_text())
    notes = {(a["image_id"], a["track_id"]): (*a["bbox"], STATES.index(a["state"])) for a in coco["annotations"]}
    check_same(notes, rows)
    assert [one["id"] for one in coco["images"]] == list(range(1, FRAMES + 1))
    found = json.loads((folder / "objects.json").read_text())["objects"]
    for one in found:
        mine = sorted(frame for frame, number in rows if number == one["object"])
        assert (one["appeared"], one["disappeared"]) == pytest.approx(((mine[0] - 1) / FPS, (mine[-1] - 1) / FPS))
        for row in one["path"]:
            left, top, right, bottom = row["box"]
            same = (left, top, right - left, bottom - top, STATES.index(row["state"]))
            assert rows[row["frame"], one["object"]] == pytest.approx(same, abs=0.02)
    page = (folder / "report.html").read_text()
    for one in found:
        assert f"{one['appeared']:.1f} -" in page
        assert f"{one['color']}, moving {one['direction']}" in page


def test_the_overlay_has_the_boxes_of_the_rows(runs: tuple[Path, Path]) -> None:
    """A rectangle in the color of its object wherever a row says so, and none elsewhere."""
    rows = rows_of(runs[0])
    color = {one["object"]: one["color"] for one in json.loads((runs[0] / "objects.json").read_text())["objects"]}
    video = cv2.VideoCapture(str(runs[0] / "overlay.mp4"))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == FRAMES
    for n in range(FRAMES):
        image = video.read()[1][..., ::-1].astype(int)
        own = {number: row for (frame, number), row in rows.items() if frame == n + 1}
        for number, (left, top, width, *_) in own.items():
            edge = image[max(0, round(top) - 1) : round(top) + 2, round(left + 4) : max(round(left + width - 4), 1)]
            # Where two blocks meet, the label of one covers the box of the other.
            if edge.size and 12 < left < SIZE[1] - 60 and not 75 < n < 115:
                assert (abs(edge - rgb(color[number])) < 90).all(-1).mean() > 0.1
        if not own:
            assert not (abs(image - rgb("red")) < 60).all(-1).any()


def test_after_sigterm_there_are_tables_and_no_figures(runs: tuple[Path, Path], tmp_path: Path) -> None:
    chunks = count()

    def end_after_five_seconds(frames: int) -> None:
        if next(chunks) == 12:
            signal.raise_signal(signal.SIGTERM)

    job = BindJob(source=str(runs[0].parent.parent / "blocks.mkv"))
    with ended_like_ctrl_c():
        result, _, files = bind_source(job, tmp_path, begin=lambda *_: end_after_five_seconds)
    assert result.interrupted
    tables = {"coco.json", "mot.txt", "objects.json", "responses.parquet", "tracks.csv", "tracks.parquet"}
    assert {path.name for path in files} == tables | {"report.html", "state.safetensors"}
    check_same(rows_of(tmp_path / "blocks"), {key: row for key, row in rows_of(runs[0]).items() if key[0] <= 104})


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_pycocotools_reads_boxes_and_masks(runs: tuple[Path, Path]) -> None:
    coco = pytest.importorskip("pycocotools.coco").COCO(str(runs[0] / "coco.json"))
    for one in coco.dataset["annotations"]:
        mask = coco.annToMask(one)
        assert mask.shape == SIZE
        assert mask.sum() == one["area"]
        if STATES.index(one["state"]) == 1:
            rows, columns = np.nonzero(mask)
            left, top, width, height = one["bbox"]
            assert (columns.min(), rows.min()) == pytest.approx((left, top), abs=8)
            assert (np.ptp(columns), np.ptp(rows)) == pytest.approx((width, height), abs=12)


def test_pandas_reads_the_tables(runs: tuple[Path, Path]) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    table, text = pandas.read_parquet(runs[0] / "tracks.parquet"), pandas.read_csv(runs[0] / "tracks.csv")
    pandas.testing.assert_frame_equal(table, text, check_dtype=False, atol=1e-4)
    assert table.time.to_numpy() == pytest.approx((table.frame - 1) / FPS)
    blue = table[table.feature_blue > 0.5]
    assert blue.speed.median() == pytest.approx(4 * FPS, rel=0.1)


class Signals:
    """What a model over the whole field gives for a chunk of three steps; labels as of one with tracks."""

    def __init__(self, start: float) -> None:
        self.time = start + torch.arange(3) / 4
        self.inputs = self.outputs = torch.arange(30.0).reshape(3, 10) + start
        self.labels = torch.zeros(3, 20, 30, dtype=torch.int32)
        self.labels[1, 4:9, 10:13] = 8
        self.labels[1, 5, 11] = 0


def test_masks_come_back_as_they_were() -> None:
    store, signals = MaskStore(), Signals(0.0)
    store.add(signals.time, signals.labels)
    assert store.find(7, 0.0) is None
    mask = store.find(7, 0.25)
    assert mask is not None
    assert (mask.top, mask.left) == (4, 10)
    np.testing.assert_array_equal(mask.pixels, signals.labels[1, 4:9, 10:13].numpy() == 8)


def test_responses_are_a_table(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    read = list[Any]()

    def visible(state: Any) -> list[BoundObject]:
        read.append(state)
        return owners()[: len(read) - 1]

    model: Any = SimpleNamespace(visible_objects=visible, confidence=lambda state: None)
    file = ResponseFile(tmp_path / "responses.parquet", model)
    for n in range(3):
        file.signals(Signals(0.75 * n), torch.full((10, 10), n / 2), n)
    file.close()
    table = parquet.read_table(tmp_path / "responses.parquet").to_pydict()
    assert table["time"] == [0, 0.25, 0.5, 0.75, 1, 1.25, 1.5, 1.75, 2]
    assert table["output_red"] == [7, 17, 27, 7.75, 17.75, 27.75, 8.5, 18.5, 28.5]
    assert [row and row[0] for row in table["weights"]] == [None, None, 0, None, None, 0.5, None, None, 1]
    # The objects are read once a second.
    assert table["count"] == [0] * 6 + [1] * 3
    assert table["objects"][-1].startswith("red")
