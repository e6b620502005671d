"""Reports, figures, exports and recordings, read by the programs that they are for."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from ndtorch.binding import BoundObject, Verdict, bound_objects, object_table
from ndtorch.cli.commands import main
from ndtorch.report.exports import ResponseFile, run_lengths
from ndtorch.report.films import CROP_SIDE, EnhancedVideo, Gallery, Overlay, marked, rgb
from ndtorch.report.page import Page, Shown, Table
from ndtorch.report.plots import draw_all
from ndtorch.report.recording import Recording, why_not_whole
from ndtorch.report.summary import in_words, summary
from ndtorch.report.tracks import MaskStore, Placed
from ndtorch.run.result import Moment, Picture, RunResult, Trace
from ndtorch.scenes.video_writer import VideoWriter
from ndtorch.vision.features import FEATURES
from tests.foreground.passing_scenes import ground

RNG = np.random.default_rng(5)


def run_of(objects: list[BoundObject], verdict: Verdict = "stable", owners: bool = True) -> RunResult:
    table = object_table(torch.zeros(10, 10)) if owners else None
    blank = Trace((10,)), Trace((10, 10)), np.zeros((10, 10), np.float32)
    return RunResult("clip", "published", (60, 80), objects, verdict, table, None, 0.0, 3.0, 1.5, 30, *blank, {})


CAR = BoundObject(
    "red",
    7,
    {"red": 1.0, "right": 0.5},
    place=(40.0, 30.0),
    first_seen=1.0,
    last_seen=2.0,
    track=0,
    heading=(1.0, 0.0),
    path=((1.0, 8.0, 30.0), (1.1, 12.0, 30.0), (1.2, 16.0, 30.0), (2.0, 40.0, 30.0)),
)


def owners() -> list[BoundObject]:
    weights = torch.zeros(10, 10)
    weights[[1, 2, 4, 6], 7] = torch.tensor([0.8, 0.6, 0.4, 0.3])
    return bound_objects(object_table(weights))


def test_a_page_is_one_file_and_fetches_nothing(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((30, 90, 3), 200, dtype=np.uint8))
    shown = [Shown(tmp_path / "a.png", "A picture", "grey"), Shown(tmp_path / "none.png", "Nothing", "not there")]
    (tmp_path / "out").mkdir()
    table = Table("A table", ["column"], [["cell"]])
    page = Page("<b> & co", ["2 objects"], "ndtorch bind x", {"model": "published"}, [table], shown)
    text = page.write(tmp_path / "out").read_text(encoding="utf-8")
    assert "&lt;b&gt; &amp; co" in text
    assert "Nothing" not in text
    addresses = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert len(addresses) == 2
    assert all(address.startswith("data:") for address in addresses)


def test_tracks_in_words_and_as_data() -> None:
    result = run_of([CAR], owners=False)
    assert "object 1:   1.0 -   2.0 s  red, moving right" in in_words(result)
    (thing,) = json.loads(json.dumps(summary(result)))["objects"]
    # Shares of height and width, five a second at most.
    assert thing["path"] == [[1.0, 0.5, 0.1], [1.2, 0.5, 0.2], [2.0, 0.5, 0.5]]
    assert (thing["color"], thing["direction"], thing["appeared"]) == ("red", "right", 1.0)


def test_owners_in_words_and_as_data() -> None:
    result = run_of(owners())
    text = in_words(result)
    assert "object 1: red, moving right and down, orientation between 0° and 120°" in text
    assert "red           .   1.00   0.75" in text
    assert summary(result)["objects"] == [{"neuron": "red", "features": result.objects[0].features}]


@pytest.mark.parametrize("verdict", ["learning", "static", "alternating"])
def test_nothing_found_has_a_reason(verdict: Verdict) -> None:
    assert "no objects" in in_words(run_of([], verdict))
    assert f"verdict  {verdict}: " in in_words(run_of([], verdict))
    assert "must stand still" in in_words(run_of([], verdict, owners=False))


def test_figures_are_drawn_of_a_long_run_a_short_one_and_an_empty_one(tmp_path: Path) -> None:
    empty, run = run_of([]), run_of(owners())
    for n in range(300):
        run.outputs.add(n / 10 - 4, torch.rand(10))
        run.weights.add(n / 10 - 4, torch.rand(10, 10))
    run.final_weights = np.random.default_rng(0).random((10, 10)).astype(np.float32)
    frame = RNG.integers(0, 256, (50, 60, 3), np.uint8)
    run.moments = {7: Moment(3.0, 7, 0.5, frame, frame // 4)}
    for number, result in enumerate((empty, run)):
        for path in draw_all(result, tmp_path / str(number)):
            picture = cv2.imread(str(path))
            assert picture is not None
            assert (picture < 128).mean() > 0.001


def test_a_trace_keeps_evenly_spaced_samples_in_bounded_memory() -> None:
    trace = Trace((1,), most=100)
    for n in range(10_000):
        trace.add(n / 10, torch.tensor([float(n)]))
    assert 33 <= len(trace.times) <= 100
    assert len(set(np.diff(trace.times).round(6))) == 1
    np.testing.assert_allclose(trace.samples[:, 0], 10 * trace.times)


def boxed(number: int, box: tuple[float, float, float, float]) -> BoundObject:
    return BoundObject("red", 7, {"red": 1.0}, place=(0, 0), track=number, number=number, boxes=(box,))


def test_the_gallery_has_the_largest_view_and_the_fullest_picture(tmp_path: Path) -> None:
    gallery = Gallery()
    for n in range(40):
        frame = np.zeros((120, 192, 3), np.uint8)
        frame[40:70, 3 * n : 3 * n + 12 + n % 5] = (255, 0, 0)
        things = [boxed(1, (3 * n, 40, 3 * n + 12 + n % 5, 70))]
        gallery.picture(Picture(n / 5, frame, objects=(*things, *[boxed(2, (80, 90, 90, 95))] * (n == 30))))
    gallery.write(tmp_path)
    sheet = cv2.imread(str(tmp_path / "objects.jpg"))
    assert sheet is not None
    assert sheet.shape[1] == 2 * (CROP_SIDE + 30)
    assert gallery.poster is not None
    assert (gallery.poster[1][40:70, 90:102] == (255, 0, 0)).all()


def test_marks_are_in_the_color_of_the_object() -> None:
    frame = np.full((120, 160, 3), 90, np.uint8)
    image = marked(frame, (boxed(1, (20, 30, 60, 80)), BoundObject("blue", 9, {"blue": 1.0}, place=(120, 60))))
    for part, color in ((image[30:80, 18:23], "red"), (image, "blue")):
        assert (abs(part.astype(int) - rgb(color)) < 60).all(-1).any()
    assert (frame == 90).all()


@pytest.mark.parametrize("kind", [EnhancedVideo, Overlay])
def test_films_have_a_frame_for_every_picture(kind: Any, tmp_path: Path) -> None:
    film = kind(tmp_path / "film.mp4", 5.0, (61, 80))
    for n in range(4):
        frame = np.full((61, 80, 3), 40 * n, np.uint8)
        film.picture(Picture(n / 5, frame, frame // 10 if kind is EnhancedVideo else None))
    film.close()
    video = cv2.VideoCapture(str(tmp_path / "film.mp4"))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == 4


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


def overlap(first: np.ndarray, second: tuple[int, int, int, int]) -> float:
    """Intersection over union."""
    sides = [min(first[k] + first[k + 2], second[k] + second[k + 2]) - max(first[k], second[k]) for k in (0, 1)]
    both = max(0.0, sides[0]) * max(0.0, sides[1])
    return both / (first[2] * first[3] + second[2] * second[3] - both)


@pytest.fixture(scope="module", params=["quick film, from frame 5", "folder with gaps"])
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str] | None]:
    """A run's folder, and the names of the source's files."""
    tmp, names, more = tmp_path_factory.mktemp("exports"), None, list[str]()
    if request.param == "folder with gaps":
        source, names = tmp / "square", [f"img_{3 * n:04d}.png" for n in range(FRAMES)]
        source.mkdir()
        for n, name in enumerate(names):
            cv2.imwrite(str(source / name), picture(n).permute(1, 2, 0).numpy()[..., ::-1])
    else:
        source, more = tmp / "square.mp4", ["--start", "5"]
        with VideoWriter(source, 40.0, SIZE) as film:
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
    true = [(STEP * (int(row[0]) - 1 - FIRST), TOP, SIDE, SIDE) for row in inside]
    assert np.mean([overlap(row[2:6], box) for row, box in zip(inside, true, strict=True)]) > 0.8
    (thing,) = json.loads((run[0] / "objects.json").read_text())["objects"]
    assert (thing["color"], thing["direction"]) == ("red", "right")
    assert json.loads((run[0] / "timeline.jsonl").read_text()) == thing
    for name in ("timeline.png", "poster.jpg", "objects.jpg", "report.html", "overlay.mp4"):
        assert (run[0] / name).stat().st_size > 1000


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


def test_pandas_reads_the_tables(run: tuple[Path, list[str] | None]) -> None:
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    table, text = pandas.read_parquet(run[0] / "tracks.parquet"), pandas.read_csv(run[0] / "tracks.csv")
    assert list(table.columns) == list(text.columns)
    rate = (table.frame.iloc[-1] - table.frame.iloc[0]) / (table.time.iloc[-1] - table.time.iloc[0])
    assert table.time.iloc[0] == pytest.approx((table.frame.iloc[0] - 1) / rate, abs=1e-3)
    assert table.speed.median() == pytest.approx(STEP * rate, rel=0.1)
    assert (table.feature_red > 0.5).all()
    mot = np.loadtxt(run[0] / "mot.txt", delimiter=",", ndmin=2)
    columns = ["frame", "track", "left", "top", "width", "height", "confidence"]
    assert np.allclose(table[columns], mot[:, :7], atol=1e-2)
    scores = [one["score"] for one in json.loads((run[0] / "coco.json").read_text())["annotations"]]
    assert min(scores) == pytest.approx(table.confidence.min(), abs=1e-3)


@pytest.mark.parametrize("top", [0, 3])
@pytest.mark.parametrize("left", [0, 4])
def test_run_lengths_are_those_of_pycocotools(top: int, left: int) -> None:
    masks = pytest.importorskip("pycocotools.mask")
    crop = np.random.default_rng(0).random((40, 30)) < 0.7
    crop[:, 5:8] = True
    full = np.zeros((40 + top, 30 + left), np.uint8)
    full[top:, left:] = crop
    want = masks.encode(np.asfortranarray(full))
    assert run_lengths(Placed(top, left, crop), *full.shape).encode() == want["counts"]


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
    store.signals(signals, torch.zeros(10, 10), None)
    assert store.find(7, 0.0) is None
    mask = store.find(7, 0.25)
    assert mask is not None
    assert (mask.top, mask.left) == (4, 10)
    np.testing.assert_array_equal(mask.pixels, signals.labels[1, 4:9, 10:13].numpy() == 8)


def test_responses_are_a_table(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    file = ResponseFile(tmp_path / "responses.parquet")
    for n in range(2):
        file.signals(Signals(float(n)), torch.full((10, 10), n / 2), None)
    file.close()
    table = parquet.read_table(tmp_path / "responses.parquet").to_pydict()
    assert table["time"] == [0, 0.25, 0.5, 1, 1.25, 1.5]
    assert table["output_red"] == [7, 17, 27, 8, 18, 28]
    assert [row and row[0] for row in table["weights"]] == [None, None, 0, None, None, 0.5]


def test_a_recording_holds_pictures_outputs_weights_and_objects(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    recording = Recording(tmp_path / "new" / "run.rrd")
    for n in range(2):
        frame = RNG.integers(0, 256, (20, 30, 3), np.uint8)
        recording.signals(Signals(float(n)), torch.full((10, 10), n / 2), None)
        recording.picture(Picture(n + 0.6, frame, frame if n else None, 7))
    recording.finish("red, moving right")
    assert why_not_whole(recording.path) is None
    rows: Counter[str] = Counter()
    for chunk in RrdReader(recording.path).stream().to_chunks():
        if not chunk.is_static:
            rows[chunk.entity_path] += chunk.num_rows
        elif chunk.entity_path == "/outputs":
            names = chunk.to_record_batch().column("SeriesLines:names").to_pylist()[0]
            assert names == list(FEATURES)
    assert rows == {"/outputs": 6, "/input": 2, "/enhanced": 2, "/winner": 2, "/weights": 2, "/objects": 1}


def test_a_recording_that_was_cut_is_said_not_to_be_whole(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    recording = Recording(tmp_path / "run.rrd")
    recording.finish("nothing")
    recording.path.write_bytes(recording.path.read_bytes()[:-80])
    assert "is not whole" in str(why_not_whole(recording.path))
