"""The command line: what it prints, what it writes, and what it says about input it cannot use."""

from __future__ import annotations

import json
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file

import ndtorch
from ndtorch.binding.rules import RULES
from ndtorch.binding.saving import save_tensors
from ndtorch.checked import CHECKSUM
from ndtorch.commands import main
from ndtorch.scenes import SCENES, two_bars
from ndtorch.scenes.video_writer import VideoWriter

TRACKED = {"objects.json", "overlay.mp4", "report.html", "state.safetensors", "timeline.jsonl", "timeline.png"}
FILES = {
    "enhanced.mp4",
    "frames.png",
    "objects.json",
    "outputs.png",
    "report.html",
    "state.safetensors",
    "weights.png",
    "weights_over_time.png",
}
PICTURES = {"frames.png", "outputs.png", "weights.png", "weights_over_time.png"}
SMALL = (160, 160)
CAR = Path(__file__).resolve().parents[2] / "shared" / "data" / "car-detection.mp4"


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One second of the two bars at 25 frames a second, small, as a video file."""
    path = tmp_path_factory.mktemp("clip") / "bars.avi"
    with VideoWriter(path, 25, SMALL) as writer:
        for chunk in two_bars(seconds=1.0, size=SMALL, fps=25).chunks():
            for frame in chunk:
                writer.write(frame)
    return path


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without figures, for tests of something else: drawing them takes longer than a short run."""
    monkeypatch.setattr("ndtorch.report.folder.draw_all", lambda result, folder: [])


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str], *words: str) -> None:
    """The command ends with code 2, one line that holds the words, and nothing on stdout."""
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    lines = [line for line in err.splitlines() if line.startswith("error:")]
    assert out == ""
    assert len(lines) == 1
    for word in words:
        assert word in lines[0]


@pytest.mark.usefixtures("undrawn")
def test_json_is_one_object_and_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bind", "one-bar", "--seconds", "0.5", "--settle", "0.2", "--json", "--out", str(tmp_path)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed) == {
        "source",
        "model",
        "objects",
        "cuts",
        "verdict",
        "max_weight",
        "spectral_radius",
        "weights",
        "simulated_seconds",
        "wall_seconds",
        "frames_per_second",
    }
    assert (printed["source"], printed["model"]) == ("one-bar", "published")
    assert printed["simulated_seconds"] == pytest.approx(0.7)
    assert np.array(printed["weights"]).shape == (10, 10)
    assert {path.name for path in (tmp_path / "one-bar").iterdir()} == FILES - PICTURES
    assert json.loads((tmp_path / "one-bar" / "objects.json").read_text()) == printed
    # Nothing is left of the folder the files were made in.
    assert [path.name for path in tmp_path.iterdir()] == ["one-bar"]


@pytest.mark.slow
def test_default_run_names_both_bars_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bind", "--pictures", "2", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("model  published (default for scenes)\n")
    assert "object 1: red, moving right and down, orientation between 0° and 120°" in out
    assert "object 2: green, moving left and down, orientation between 0° and 60°" in out
    assert "verdict  stable" in out
    assert {path.name for path in (tmp_path / "two-bars").iterdir()} == FILES
    video = cv2.VideoCapture(str(tmp_path / "two-bars" / "enhanced.mp4"))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == 38
    assert int(video.get(cv2.CAP_PROP_FRAME_WIDTH)) == 1000
    for name in ("outputs", "weights", "weights_over_time", "frames"):
        picture = cv2.imread(str(tmp_path / "two-bars" / f"{name}.png"))
        # Something is drawn on the paper.
        assert picture is not None
        assert (picture < 128).mean() > 0.001


def kept(out: Path) -> dict[str, torch.Tensor]:
    """Every tensor of the state that a run left."""
    return load_file(out / "state.safetensors")


def same_state(whole: Path, rest: Path) -> dict[str, torch.Tensor]:
    """Both runs ended in the same state, bit for bit; gives it."""
    one, other = kept(whole), kept(rest)
    assert set(one) == set(other)
    assert [name for name in one if not torch.equal(one[name], other[name])] == []
    return one


@pytest.mark.usefixtures("undrawn")
def test_resumed_run_equals_an_uninterrupted_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = ["bind", "two-bars", "--settle", "0.3", "--pictures", "5"]
    assert main([*short, "--seconds", "1.1", "--out", str(tmp_path / "whole")]) == 0
    assert main([*short, "--seconds", "0.4", "--out", str(tmp_path / "part")]) == 0
    capsys.readouterr()
    part = str(tmp_path / "part" / "two-bars")
    assert main(["bind", "--resume", part, "--seconds", "0.7", "--pictures", "5", "--out", str(tmp_path / "rest")]) == 0
    assert capsys.readouterr().out.startswith("model  published (that of the run that goes on)\n")
    state = same_state(tmp_path / "whole" / "two-bars", tmp_path / "rest" / "two-bars")
    assert float(state["second.weights"].max()) > 0


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("model", "options", "rows"),
    [
        # One step a frame where the settled network needs no shorter one, and 100 a second where it does.
        ("published", ["--settle", "0.2"], 97),
        ("scale-free", ["--gamma", "0.3", "--settle", "0.1"], 25),
        ("video", ["--without", "scale"], 25),
    ],
)
def test_resumed_video_goes_on_bit_for_bit_with_its_model(
    model: str, options: list[str], rows: int, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["bind", str(clip), "--model", model, *options, "--pictures", "0"]
    part = str(tmp_path / "part" / "bars")
    assert main([*asked, "--out", str(tmp_path / "whole")]) == 0
    assert main([*asked, "--seconds", "0.4", "--out", str(tmp_path / "part")]) == 0
    assert main(["bind", "--resume", part, "--pictures", "0", "--out", str(tmp_path / "rest")]) == 0
    state = same_state(tmp_path / "whole" / "bars", tmp_path / "rest" / "bars")
    assert rows in [int(value) for name, value in state.items() if name.endswith((".steps", ".frames"))]
    found = [json.loads((tmp_path / name / "bars" / "objects.json").read_text()) for name in ("whole", "rest")]
    assert found[0]["objects"] == found[1]["objects"]
    assert found[0]["weights"] == found[1]["weights"]
    capsys.readouterr()
    other = "published" if model != "published" else "video"
    resumed = ["bind", "--resume", part, "--out", str(tmp_path)]
    refused([*resumed, "--model", other], capsys, model, other)
    if model != "published":
        refused([*resumed, "--rule", "hebbian"], capsys, "--rule is an option of published", model)


@pytest.mark.usefixtures("undrawn")
def test_a_state_with_a_number_that_is_none_is_refused(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    quick = ["--seconds", "0.2", "--pictures", "0"]
    assert main(["bind", str(clip), "--model", "published", *quick, "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    path = tmp_path / "bars" / "state.safetensors"
    with safe_open(path, "pt") as file:
        about = file.metadata()
    state = kept(tmp_path / "bars")
    state["second.weights"][0, 1] = torch.nan
    save_tensors(state, path, {key: text for key, text in about.items() if key != CHECKSUM})
    refused(["bind", "--resume", str(path.parent), "--out", str(tmp_path)], capsys, str(path), "second.weights", "NaN")


@pytest.mark.usefixtures("undrawn")
def test_a_folder_of_ones_own_is_a_model(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ndtorch.load("scale-free", gamma=0.4).save(tmp_path / "mine")
    asked = ["bind", str(clip), "--model", str(tmp_path / "mine"), "--seconds", "0.4", "--pictures", "0"]
    assert main([*asked, "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.startswith(f"model  {tmp_path / 'mine'} (scale-free)\n")
    again = ["bind", str(clip), "--model", "scale-free", "--gamma", "0.4", *asked[4:], "--out", str(tmp_path / "again")]
    assert main(again) == 0
    same_state(tmp_path / "out" / "bars", tmp_path / "again" / "bars")
    capsys.readouterr()
    refused([*asked, "--rule", "hebbian", "--out", str(tmp_path)], capsys, "--rule", "published", "scale-free")


def test_video_runs_at_its_own_rate(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bind", str(clip), "--start", "5", "--stop", "20", "--json", "--out", str(tmp_path)]) == 0
    assert json.loads(capsys.readouterr().out)["simulated_seconds"] == pytest.approx(15 / 25)


@pytest.mark.slow
@pytest.mark.skipif(not CAR.is_file(), reason="shared/data/car-detection.mp4 is not here")
@pytest.mark.parametrize("part", [[], ["--start", "170", "--stop", "245"]])
def test_road_camera_gets_an_honest_verdict(
    part: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The published model was made for other input: no object is claimed before anything has been learned."""
    assert main(["bind", str(CAR), *part, "--model", "published", "--json", "--out", str(tmp_path)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["verdict"] in ("learning", "alternating")
    assert printed["objects"] == []
    assert printed["simulated_seconds"] == pytest.approx((75 if part else 377) / 12.5)
    assert {path.name for path in (tmp_path / "car-detection").iterdir()} == FILES


@pytest.mark.usefixtures("undrawn")
def test_recording_is_written_beside_the_rest(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    rrd = tmp_path / "run.rrd"
    assert main(["bind", "--seconds", "0.3", "--settle", "0.1", "--rrd", str(rrd), "--out", str(tmp_path)]) == 0
    assert rrd.stat().st_size > 10_000


def test_grey_video_is_taken_and_said_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    rng = np.random.default_rng(0)
    for i in range(4):
        cv2.imwrite(str(folder / f"{i}.png"), rng.integers(0, 255, (40, 60), dtype=np.uint8))
    assert main(["bind", str(folder), "--pictures", "0", "--out", str(tmp_path / "out")]) == 0
    assert "grey" in capsys.readouterr().err


def test_one_picture_cannot_show_motion(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    cv2.imwrite(str(folder / "1.png"), np.full((40, 60, 3), 90, dtype=np.uint8))
    for model in ("video", "published"):
        refused(
            ["bind", str(folder), "--model", model, "--json", "--out", str(tmp_path / "out")], capsys, "motion", "two"
        )
    assert not (tmp_path / "out" / "frames").exists()


def test_a_folder_with_pictures_of_two_sizes_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for name, size in (("1.png", (40, 60, 3)), ("2.png", (40, 64, 3))):
        cv2.imwrite(str(folder / name), np.full(size, 90, dtype=np.uint8))
    words = ("1.png is 60 x 40", "2.png 64 x 40")
    refused(["bind", str(folder), "--json", "--out", str(tmp_path / "out")], capsys, *words)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.long)]
)
def test_ctrl_c_keeps_what_was_computed(number: int, code: int, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ndtorch", "bind", "--seconds", "600", "--pictures", "2", "--out", str(tmp_path)]
    # There is a progress bar where stderr is a terminal.
    ours, theirs = os.openpty()
    termios.tcsetwinsize(theirs, (24, 100))  # the bar fits itself into the terminal
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, text=True) as process:
        os.close(theirs)
        try:
            # The first frames have been seen when the progress bar counts them.
            seen, end = "", time.monotonic() + 120
            while " 0/" in seen[-200:] or "/60400" not in seen:
                assert select.select([ours], [], [], end - time.monotonic())[0], seen
                seen += os.read(ours, 4096).decode(errors="replace")  # the bar's characters may be cut in two
            process.send_signal(number)
            out, _ = process.communicate(timeout=120)
        finally:
            process.kill()
            os.close(ours)
    assert process.returncode == code
    assert "stopped early" in out
    assert {path.name for path in (tmp_path / "two-bars").iterdir()} == FILES
    assert [path.name for path in tmp_path.iterdir()] == ["two-bars"]


def test_a_second_run_leaves_the_first_alone(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also one of another clip that has the same name."""
    (tmp_path / "elsewhere").mkdir()
    other = Path(shutil.copy(clip, tmp_path / "elsewhere"))
    asked = ["--seconds", "0.2", "--pictures", "0", "--out", str(tmp_path / "out")]
    for source, name in ((clip, "bars"), (other, "bars-2"), (clip, "bars-3")):
        assert main(["bind", str(source), *asked]) == 0
        out, err = capsys.readouterr()
        assert f"written  {tmp_path / 'out' / name}: " in out
        assert err == ""  # a progress bar is for terminals
    first = (tmp_path / "out" / "bars" / "objects.json").stat().st_mtime_ns
    assert main(["bind", str(clip), *asked, "--force"]) == 0
    assert (tmp_path / "out" / "bars" / "objects.json").stat().st_mtime_ns > first
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["bars", "bars-2", "bars-3"]


def test_a_full_disk_leaves_the_state(
    clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(result: object, path: Path) -> None:
        path.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("ndtorch.report.folder.draw_timeline", full)
    assert main(["bind", str(clip), "--seconds", "0.2", "--pictures", "0", "--json", "--out", str(tmp_path)]) == 1
    assert capsys.readouterr().err == "error: figures cannot be written: No space left on device\n"
    assert {path.name for path in (tmp_path / "bars").iterdir()} == {"objects.json", "state.safetensors"}


def test_scenes_lists_what_render_takes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes"]) == 0
    assert "two-bars-random" in capsys.readouterr().out
    file = tmp_path / "three.mkv"
    assert main(["render", "three-bars", str(file), "--seconds", "0.1"]) == 0
    video = cv2.VideoCapture(str(file))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == 10
    ok, frame = video.read()
    assert ok
    # Three bars: something in each color plane.
    assert (frame.reshape(-1, 3).max(0) > 60).all()


def test_lists_and_files_are_one_json_object(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scenes", "--json"]) == 0
    assert set(json.loads(capsys.readouterr().out)) == set(SCENES)
    file = tmp_path / "bar.avi"
    render = ["render", "one-bar", str(file), "--seconds", "0.1", "--json"]
    assert main(render) == 0
    about = {"file": str(file), "frames": 10, "width": 500, "height": 500, "fps": 100.0}
    assert json.loads(capsys.readouterr().out) == about
    refused(render, capsys, str(file), "--force")
    assert main([*render, "--force"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["bar.avi"]


def test_quiet_prints_errors_alone(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["bind", str(clip), "--seconds", "0.2", "--pictures", "0", "--out", str(tmp_path)]
    assert main([*asked, "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main([*asked, "-q", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["model"] == "figures"
    assert err == ""
    refused(["bind", "four-bars", "-q", "--out", str(tmp_path)], capsys, "four-bars")


def test_a_source_that_was_probably_meant(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(["bind", "two-bar", "--out", str(tmp_path)], capsys, "did you mean two-bars?")
    mistyped = str(clip.with_name("bras.avi"))
    refused(["bind", mistyped, "--out", str(tmp_path)], capsys, mistyped, f"did you mean {clip}?")
    assert list(tmp_path.iterdir()) == []


def test_help_shows_what_options_take(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["bind", "--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    (given,) = re.findall(r"--model \{(.*?)\}", text)
    assert set(given.split(",")) == {*ndtorch.model_names(), "FOLDER"}
    assert "--rule {competitive,cooperative,hebbian}" in text
    assert {"competitive", "cooperative", "hebbian"} <= set(RULES)
    assert "--quiet" in text
    assert "default: None" not in text
    assert "(default: two-bars)" in " ".join(text.replace("│", " ").split())


def test_unknown_scene_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    refused(["bind", "four-bars", "--out", str(out)], capsys, "four-bars", "two-bars")
    refused(["render", "four-bars", str(tmp_path / "x.mp4")], capsys, "four-bars", "two-bars")
    # Nothing half-written.
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{clip}", "--gamma", "1"], ["--gamma is an option of published, scale-free; the model is figures"]),
        (["{clip}", "--rule", "hebbian"], ["--rule is an option of published; the model is figures"]),
        (["{clip}", "--fit", "stretch"], ["--fit", "published", "the model is figures"]),
        (["two-bars", "--without", "scale"], ["--without is an option of video; the model is published"]),
        (["{clip}", "--model", "published", "--without", "scale"], ["--without is an option of video"]),
        (["two-bars", "--model", "scale-free", "--order", "printed"], ["--order is an option of published"]),
        (["{clip}", "--model", "video", "--without", "sight"], ["without", "exposure", "sight"]),
        (["two-bars", "--model", "cubist"], ["model", "published", "video", "cubist"]),
        (["two-bars", "--rule", "scale-free"], ["--model scale-free"]),
        (["{clip}", "--front-end", "on"], ["--model video"]),
        (["{clip}", "--front-end", "off"], ["--model published"]),
    ],
)
def test_what_a_model_does_not_know_is_refused(
    arguments: list[str], words: list[str], clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [argument.format(clip=clip) for argument in arguments]
    refused(["bind", *given, "--out", str(tmp_path / "out")], capsys, *words)
    assert not (tmp_path / "out").exists()


def test_a_recording_changes_nothing(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rerun")
    found = []
    for name, more in (("plain", []), ("recorded", ["--rrd", str(tmp_path / "run.rrd")])):
        assert main(["bind", str(clip), *more, "--out", str(tmp_path / name)]) == 0
        assert capsys.readouterr().out.startswith("model  figures (default for files and cameras)\n")
        folder = tmp_path / name / "bars"
        assert {path.name for path in folder.iterdir()} == TRACKED
        found.append(json.loads((folder / "objects.json").read_text(encoding="utf-8")))
    assert (tmp_path / "run.rrd").stat().st_size > 10_000
    for key in ("model", "objects", "weights", "verdict"):
        assert found[0][key] == found[1][key]


def test_help_and_scenes_answer_before_torch_is_there(tmp_path: Path) -> None:
    program = (
        "import sys\nfrom ndtorch.commands import main\n"
        "from ndtorch.cli import Bind, Render, Scenes\n"
        "Scenes().run()\nprint([n for n in ('torch', 'cv2', 'matplotlib') if n in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert "two-bars-random" in done.stdout
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rule", "oja"], ["rule", "competitive"]),
        (["--order", "last"], ["order", "filter-first"]),
        (["--gamma", "-1"], ["gamma", "-1"]),
        (["--gamma", "nan"], ["gamma", "nan"]),
        (["--seconds", "0"], ["seconds", "0"]),
        (["--seconds", "nan"], ["seconds", "nan"]),
        (["--fps", "-5"], ["fps", "-5"]),
        (["--phase", "inf"], ["phase"]),
        (["--first-stage-radius", "1.5"], ["radius", "1.5"]),
        (["--device", "abacus"], ["device", "abacus"]),
        (["--start", "3"], ["start"]),
        (["--pictures", "-1"], ["pictures", "-1"]),
        (["--resume", "nowhere"], ["nowhere", "missing"]),
    ],
)
def test_unusable_option_is_refused(
    options: list[str], words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    refused(["bind", *options, "--out", str(tmp_path / "out")], capsys, *words)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["missing", "empty", "text", "cut"])
def test_unusable_video_is_refused(kind: str, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"{kind}.avi"
    if kind != "missing":
        path.write_bytes({"empty": b"", "text": b"not a video " * 999, "cut": clip.read_bytes()[:200]}[kind])
    refused(["bind", str(path), "--out", str(tmp_path / "out")], capsys, str(path))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("source", ["camera:97", "/dev/video97"])
def test_camera_that_is_not_there_is_refused(source: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(["bind", source, "--out", str(tmp_path / "out")], capsys)
    assert not (tmp_path / "out").exists()


def test_scene_options_are_refused_for_video(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(["bind", str(clip), "--phase", "60", "--out", str(tmp_path / "out")], capsys, "phase")
    refused(["bind", str(clip), "--start", "90", "--out", str(tmp_path / "out")], capsys, "start")
    assert list(tmp_path.iterdir()) == []


def test_output_that_cannot_be_written_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    refused(["bind", "--seconds", "0.1", "--out", str(blocked)], capsys, "--out", str(blocked))
    assert blocked.read_text() == "in the way"


@pytest.mark.usefixtures("undrawn")
def test_resume_does_not_take_options_that_would_change_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bind", "--seconds", "0.1", "--settle", "0", "--pictures", "0", "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    before = {path.name: path.read_bytes() for path in (tmp_path / "two-bars").iterdir()}
    refused(["bind", "--resume", str(tmp_path / "two-bars"), "--phase", "9", "--out", str(tmp_path)], capsys, "phase")
    refused(["bind", "one-bar", "--resume", str(tmp_path / "two-bars"), "--out", str(tmp_path)], capsys, "one-bar")
    assert {path.name: path.read_bytes() for path in (tmp_path / "two-bars").iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["two-bars"]
