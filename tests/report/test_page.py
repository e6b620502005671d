"""The page of a run, and what it says in words."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

import ndtorch
from ndtorch.binding import BoundObject, Verdict, bound_objects, object_table
from ndtorch.cli.commands import main
from ndtorch.report.advice import MIN_SHIFT_PX, CameraMotion, advice, global_shift
from ndtorch.report.films import mark_of
from ndtorch.report.gallery import CROP_SIDE, GROUNDS, Gallery, contact_sheet
from ndtorch.report.mask_store import MaskStore
from ndtorch.report.page import Page, Shown, Table
from ndtorch.report.timeline import TimelineFile
from ndtorch.report.words import in_words, summary
from ndtorch.run.result import RunResult, Trace
from ndtorch.run.run import run_model
from ndtorch.run.watchers import Picture
from ndtorch.scenes.video import open_video
from ndtorch.scenes.video_writer import VideoWriter
from tests.foreground.passing_scenes import SIZE, passing


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report with a picture and a film, alone in a folder."""
    import cv2

    folder = tmp_path_factory.mktemp("files")
    cv2.imwrite(str(folder / "a.png"), np.full((300, 900, 3), 200, dtype=np.uint8))
    with VideoWriter(folder / "b.mp4", 12.5, (64, 96)) as film:
        for n in range(10):
            film.write(torch.full((3, 64, 96), 0.1 * n))
    shown = [
        Shown(folder / "a.png", "A picture", "grey"),
        Shown(folder / "b.mp4", "A film", "brighter"),
        Shown(folder / "none.png", "Nothing", "not there"),
    ]
    table = Table("A table", [f"column {n}" for n in range(20)], [["a wide cell"] * 20])
    out = tmp_path_factory.mktemp("page")
    return Page("<b> & co", ["2 objects"], "ndtorch bind x", {"model": "published"}, [table], shown).write(out)


def test_one_file_holds_everything_and_nothing_is_fetched(written: Path) -> None:
    text = written.read_text(encoding="utf-8")
    assert [path.name for path in written.parent.iterdir()] == ["report.html"]
    assert "&lt;b&gt; &amp; co" in text
    assert "Nothing" not in text
    assert "ndtorch bind x" in text
    addresses = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert len(addresses) == 3
    assert all(address.startswith("data:") for address in addresses)


def run_of(objects: list[BoundObject], verdict: Verdict = "stable", owners: bool = True) -> RunResult:
    table = object_table(torch.zeros(10, 10)) if owners else None
    blank = Trace((10,)), Trace((10, 10)), np.zeros((10, 10), np.float32)
    return RunResult(
        "clip", "published", (60, 80), objects, verdict, table, None, 0.0, 3.0, 1.5, 30, *blank, interrupted=False
    )


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


def test_an_object_has_one_number_in_words_files_and_overlay() -> None:
    later = replace(CAR, track=10, number=2)
    result = run_of([CAR, later], owners=False)
    assert "object 2:" in in_words(result)
    assert [thing["object"] for thing in summary(result)["objects"]] == [1, 2]
    assert mark_of(later) == "#2"


def test_an_object_with_a_time_is_told_with_it() -> None:
    result = run_of([CAR], owners=False)
    assert "object 1:   1.0 -   2.0 s  red, moving right" in in_words(result)
    assert "verdict" not in in_words(result)
    (thing,) = json.loads(json.dumps(summary(result)))["objects"]
    assert thing == {
        "object": 1,
        "color": "red",
        "direction": "right",
        "appeared": 1.0,
        "disappeared": 2.0,
        "neuron": "red",
        "features": {"red": 1.0, "right": 0.5},
        # Shares of height and width, five a second at most.
        "path": [[1.0, 0.5, 0.1], [1.2, 0.5, 0.2], [2.0, 0.5, 0.5]],
    }


def test_owners_are_told_by_their_features_and_a_table() -> None:
    weights = torch.zeros(10, 10)
    weights[[1, 2, 4, 6], 7] = torch.tensor([0.8, 0.6, 0.4, 0.3])
    result = run_of(bound_objects(object_table(weights)))
    text = in_words(result)
    assert "object 1: red, moving right and down, orientation between 0° and 120°" in text
    assert "red           .   1.00   0.75" in text
    assert summary(result)["objects"] == [{"neuron": "red", "features": result.objects[0].features}]


@pytest.mark.parametrize(
    ("verdict", "word"),
    [("learning", "no weight has grown"), ("static", "nothing fluctuates"), ("alternating", "flip")],
)
def test_nothing_found_is_said_with_the_reason(verdict: Verdict, word: str) -> None:
    text = in_words(run_of([], verdict))
    assert "no objects" in text
    assert word in text


FOLDER = Path(__file__).parents[3] / "shared" / "data" / "video"
RNG = np.random.default_rng(5)
TEXTURE = np.asarray(cv2.GaussianBlur(RNG.uniform(0, 255, (160, 260, 3)), (0, 0), 2), np.uint8)


def view(down: float = 0, across: float = 0, turn: float = 0) -> np.ndarray:
    """120 x 192 pixels of a texture, shifted, and turned by degrees."""
    move = cv2.getRotationMatrix2D((110, 80), turn, 1)
    move[:, 2] -= (20 + across, 20 + down)
    return np.asarray(cv2.warpAffine(TEXTURE, move, (192, 120)), np.uint8)


def grey(image: np.ndarray) -> np.ndarray:
    return np.asarray(image.mean(2), np.uint8)


@pytest.mark.parametrize(("down", "across"), [(0, 0), (0, 2), (3, -4), (0.5, 0.5)])
def test_the_shift_of_all_of_an_image_is_measured(down: float, across: float) -> None:
    assert global_shift(grey(view()), grey(view(down, across))) == pytest.approx(np.hypot(down, across), abs=0.15)


def test_a_turn_is_a_shift_and_an_object_is_none() -> None:
    assert global_shift(grey(view()), grey(view(turn=3))) > MIN_SHIFT_PX
    passing = view()
    passing[20:100, 20:100] = view(0, 30)[20:100, 20:100]
    assert global_shift(grey(view()), grey(passing)) < 0.15
    assert global_shift(grey(view()), np.full((120, 192), 90, np.uint8)) == 0
    assert global_shift(np.full((120, 192), 90, np.uint8), grey(view())) == 0


def watched(frames: list[np.ndarray], fps: float = 5.0) -> CameraMotion:
    camera = CameraMotion()
    for n, frame in enumerate(frames):
        camera.picture(Picture(n / fps, frame))
    return camera


def test_a_camera_that_begins_to_pan_is_told_within_two_seconds() -> None:
    pan = [view()] * 10 + [view(0, 2 * n) for n in range(1, 9)]
    camera = watched(pan)
    assert camera.since == pytest.approx(2.0)
    (line,) = advised(run_of([CAR], owners=False), camera)
    assert line.startswith("the camera moves, from 2.0 s on (all of the image moved in 8 of 17 pictures)")
    assert watched(pan[:12]).since is None  # a knock


@pytest.mark.parametrize("folder", sorted(FOLDER.glob("*/clip.mp4"))[:2] or [None])
def test_static_cameras_do_not_move(folder: Path | None) -> None:
    if folder is None:
        pytest.skip("needs the labelled clips of ../shared/data/video")
    from ndtorch_train.benchmark.foreground import read_clip

    clip = read_clip(folder.parent)
    step = max(1, round(clip.fps / 5))
    camera = watched([np.asarray(frame[..., ::-1], np.uint8) for frame in islice(clip.frames(), 0, 50 * step, step)])
    assert camera.since is None
    assert camera.shifted <= 0.05 * camera.compared


def advised(result: RunResult, camera: CameraMotion, labels: Sequence[np.ndarray] = ()) -> tuple[str, ...]:
    """Advice with masks of such labels."""
    with closing(MaskStore()) as store:
        for n, each in enumerate(labels):
            store.add(n / 5, each.astype(np.int32))
        return advice(result, camera, store)


def test_no_objects_has_a_reason_and_a_next_step() -> None:
    still, empty = watched([view()] * 5), run_of([], owners=False)
    (line,) = advised(empty, still)
    assert line.startswith("nothing moved")
    empty.simulated_seconds = 0.8
    assert advised(empty, still)[0].startswith("the video is 0.8 s long")
    empty.simulated_seconds, empty.full_size = 8.0, (240, 384)
    region = np.zeros((60, 96))
    region[10:14, 10:20] = 1
    (line,) = advised(empty, still, [region, np.roll(region, 3, 1)])
    assert line.startswith("1 region differed from the background, the largest 40 pixels wide")
    assert "at most 12 pixels" in line
    blink = view()
    blink[50:54, 50:56] ^= 128
    (line,) = advised(empty, watched([view(), blink]))
    assert line.startswith("everything that moved is smaller than the model takes")


def test_objects_without_a_moving_camera_need_no_advice() -> None:
    assert advised(run_of([CAR], owners=False), watched([view()] * 3)) == ()


def thing(number: int, box: tuple[float, float, float, float]) -> BoundObject:
    return BoundObject("red", 7, {}, place=(0, 0), track=number, number=number, boxes=(box,))


def test_gallery_keeps_ground_crops_and_poster_in_bounded_memory() -> None:
    gallery, ground = Gallery(), view()
    for n in range(60):
        frame = ground.copy()
        frame[40:70, 3 * n : 3 * n + 12] = (255, 0, 0)
        seen = () if n < 5 else (thing(1, (3 * n, 40, 3 * n + 12, 70)),)
        gallery.picture(Picture(n / 5, frame, objects=(*seen, thing(2, (80, 90, 90, 95))) if n == 30 else seen))
    assert len(gallery._kept) <= GROUNDS
    np.testing.assert_array_equal(gallery.ground(), ground)
    assert gallery.poster is not None
    assert {one.number for one in gallery.poster[1]} == {1, 2}
    assert set(gallery.crops) == {1, 2}
    red = (gallery.crops[1].pixels == (255, 0, 0)).all(2)
    assert 0.3 < red.mean() < 0.6  # the object and a rim
    sheet = contact_sheet(gallery.crops)
    assert sheet is not None
    assert sheet.shape[1] == 2 * (CROP_SIDE + 8)
    assert contact_sheet({}) is None
    assert Gallery().ground() is None


LATER_CAR = Path(__file__).resolve().parents[3] / "shared" / "data" / "car-detection.mp4"
FILES = {
    "coco.json",
    "mot.txt",
    "objects.jpg",
    "objects.json",
    "overlay.mp4",
    "poster.jpg",
    "report.html",
    "state.safetensors",
    "timeline.jsonl",
    "timeline.png",
    "tracks.csv",
}


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A red square passes to the right, in 2 s at 25 frames a second."""
    path = tmp_path_factory.mktemp("clip") / "square.avi"
    with VideoWriter(path, 25, SIZE) as writer:
        for frame in passing(60, 3.5, first=12):
            writer.write(frame)
    return path


def test_bind_writes_the_objects_over_time(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bind", str(clip), "--json", "--out", str(tmp_path)]) == 0
    printed = json.loads(capsys.readouterr().out)
    folder = tmp_path / "square"
    assert {path.name for path in folder.iterdir()} - {"tracks.parquet"} == FILES
    (thing,) = printed["objects"]
    assert (thing["color"], thing["direction"]) == ("red", "right")
    # It comes in at 0.48 s and is half a width from the left then.
    assert 0.4 < thing["appeared"] < 0.9
    assert thing["disappeared"] > 2.1
    columns = [column for _, _, column in thing["path"]]
    assert columns == sorted(columns)
    assert thing["path"][-1][1] == pytest.approx(56 / 112, abs=0.1)
    lines = (folder / "timeline.jsonl").read_text(encoding="utf-8").splitlines()
    assert [json.loads(line) for line in lines] == printed["objects"]
    picture = cv2.imread(str(folder / "timeline.png"))
    assert picture is not None
    # The lane is drawn in the palette's red (blue, green, red here).
    assert (abs(picture.astype(int) - [17, 51, 204]).max(-1) < 30).sum() > 500
    overlay = cv2.VideoCapture(str(folder / "overlay.mp4"))
    assert int(overlay.get(cv2.CAP_PROP_FRAME_COUNT)) == 12


def test_a_long_run_keeps_the_latest_objects_and_writes_all_as_they_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ndtorch.run.result.MAX_DETECTIONS", 30)
    path = tmp_path / "squares.avi"
    with VideoWriter(path, 25, SIZE) as writer:
        for _ in range(4):
            for frame in passing(60, 7.0, first=12):
                writer.write(frame)
    model = ndtorch.load("foreground", size=SIZE, fps=25)
    file = TimelineFile(tmp_path / "timeline.jsonl", SIZE)
    result = run_model(model, open_video(str(path), SIZE, 25), pictures_per_second=0, watchers=[file])
    numbers = [json.loads(line)["object"] for line in file.path.read_text(encoding="utf-8").splitlines()]
    assert len(numbers) == len(set(numbers)) == 4
    assert result.earlier > 0
    assert [(one.track or 0) + 1 for one in result.objects] == numbers[result.earlier :]


@pytest.mark.slow
@pytest.mark.skipif(not LATER_CAR.is_file(), reason="shared/data/car-detection.mp4 is not here")
def test_road_camera_tells_the_red_car_from_the_silver_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part = ["--start", "170", "--stop", "245", "--pictures", "0"]
    assert main(["bind", str(LATER_CAR), *part, "--json", "--out", str(tmp_path)]) == 0
    things = json.loads(capsys.readouterr().out)["objects"]
    seen = {thing["direction"]: thing["color"] for thing in things}
    assert set(seen) == {"up", "down"}
    assert seen["up"] == "red"
    assert seen["down"] in ("grey", "white", "blue")  # a silver car with a tint of blue
