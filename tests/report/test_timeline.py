"""Objects of a video: figure, JSON lines, overlay, and what the command says of them."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest

import ndtorch
from ndtorch.cli.commands import main
from ndtorch.report.timeline import TimelineFile
from ndtorch.run.run import run_model
from ndtorch.scenes.video import open_video
from ndtorch.scenes.video_writer import VideoWriter
from tests.foreground.passing_scenes import SIZE, passing

CAR = Path(__file__).resolve().parents[3] / "shared" / "data" / "car-detection.mp4"
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
@pytest.mark.skipif(not CAR.is_file(), reason="shared/data/car-detection.mp4 is not here")
def test_road_camera_tells_the_red_car_from_the_silver_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part = ["--start", "170", "--stop", "245", "--pictures", "0"]
    assert main(["bind", str(CAR), *part, "--json", "--out", str(tmp_path)]) == 0
    things = json.loads(capsys.readouterr().out)["objects"]
    seen = {thing["direction"]: thing["color"] for thing in things}
    assert set(seen) == {"up", "down"}
    assert seen["up"] == "red"
    assert seen["down"] in ("grey", "white", "blue")  # a silver car with a tint of blue
