"""The command line: what it prints, and what it writes."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import select
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

from ndtorch.binding.saving import save_tensors
from ndtorch.cli.commands import main
from tests.command_line import refused, same_state

FILES = {
    "enhanced.mp4",
    "frames.png",
    "objects.json",
    "outputs.png",
    "report.html",
    "responses.parquet",
    "state.safetensors",
    "weights.png",
}
KEYS = """
    source model objects cuts verdict confidence
    max_weight spectral_radius weights simulated_seconds wall_seconds frames_per_second
"""
PICTURES = {"frames.png", "outputs.png", "weights.png"}


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_json_is_one_object_and_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bind", "one-bar", "--seconds", "0.7", "--set", "settle=0.2", "--json", "--out", str(tmp_path)]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert set(printed) == set(KEYS.split())
    assert (printed["source"], printed["model"]) == ("one-bar", "scale-free")
    assert printed["simulated_seconds"] == pytest.approx(0.7)
    assert np.array(printed["weights"]).shape == (10, 10)
    assert {path.name for path in (tmp_path / "one-bar").iterdir()} == FILES - PICTURES
    assert json.loads((tmp_path / "one-bar" / "objects.json").read_text()) == printed
    # Nothing is left of the folder the files were made in.
    assert [path.name for path in tmp_path.iterdir()] == ["one-bar"]


@pytest.mark.slow
def test_default_run_names_both_bars_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bind", "--fps", "50", "--pictures", "2", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("model  scale-free (default for scenes)\n")
    assert "object 1: red, moving right and down, orientation between 0° and 120°" in out
    assert "object 2: green, moving left and down, orientation between 0° and 60°" in out
    assert "object 3" not in out
    assert "verdict  stable" in out
    assert {path.name for path in (tmp_path / "two-bars").iterdir()} == FILES
    video = cv2.VideoCapture(str(tmp_path / "two-bars" / "enhanced.mp4"))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == 38
    assert int(video.get(cv2.CAP_PROP_FRAME_WIDTH)) == 1000
    for name in ("outputs", "weights", "frames"):
        picture = cv2.imread(str(tmp_path / "two-bars" / f"{name}.png"))
        # Something is drawn on the paper.
        assert picture is not None
        assert (picture < 128).mean() > 0.001


@pytest.mark.slow
def test_ctrl_c_keeps_what_was_computed(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "ndtorch", "bind", "--seconds", "600", "--pictures", "2", "--out", str(tmp_path)]
    # There is a progress bar where stderr is a terminal.
    ours, theirs = os.openpty()
    termios.tcsetwinsize(theirs, (24, 100))  # the bar fits itself into the terminal
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, text=True) as process:
        os.close(theirs)
        try:
            # The first frames have been seen when the progress bar counts them.
            seen, end = "", time.monotonic() + 120
            while " 0/" in seen[-200:] or "/60000" not in seen:
                assert select.select([ours], [], [], end - time.monotonic())[0], seen
                seen += os.read(ours, 4096).decode(errors="replace")  # the bar's characters may be cut in two
            process.send_signal(signal.SIGINT)
            out, _ = process.communicate(timeout=120)
        finally:
            process.kill()
            os.close(ours)
    assert process.returncode == 130
    assert "stopped early" in out
    # On a busy computer the signal may come before a second frame, of which a film is made.
    assert {path.name for path in (tmp_path / "two-bars").iterdir()} | {"enhanced.mp4"} == FILES
    assert [path.name for path in tmp_path.iterdir()] == ["two-bars"]


def test_quiet_prints_errors_alone(clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["bind", str(clip), "--seconds", "0.2", "--pictures", "0", "--out", str(tmp_path)]
    assert main([*asked, "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main([*asked, "-q", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)["model"] == "foreground"
    assert err == ""
    refused(["bind", "four-bars", "-q", "--out", str(tmp_path)], capsys, "four-bars")


@pytest.mark.usefixtures("undrawn")
def test_resumed_run_equals_an_uninterrupted_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = ["bind", "two-bars", "--set", "settle=0.3", "--pictures", "5"]
    assert main([*short, "--seconds", "1.1", "--out", str(tmp_path / "whole")]) == 0
    assert main([*short, "--seconds", "0.4", "--out", str(tmp_path / "part")]) == 0
    capsys.readouterr()
    part = str(tmp_path / "part" / "two-bars")
    assert main(["bind", "--resume", part, "--seconds", "0.7", "--pictures", "5", "--out", str(tmp_path / "rest")]) == 0
    assert capsys.readouterr().out.startswith("model  scale-free (that of the run that goes on)\n")
    state = same_state(tmp_path / "whole" / "two-bars", tmp_path / "rest" / "two-bars")
    assert float(state["second.network.weights"].max()) > 0


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("model", "options", "rows"),
    [
        # One step a frame where the settled network needs no shorter one, and 100 a second where it does.
        ("published", ["settle=0.2"], 97),
        ("scale-free", ["gamma=0.3", "network.settle=0.1"], 25),
        ("foreground", [], 25),
    ],
)
def test_resumed_video_goes_on_bit_for_bit_with_its_model(
    model: str, options: list[str], rows: int, clip: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = [word for option in options for word in ("--set", option)]
    asked = ["bind", str(clip), "--model", model, *settings, "--pictures", "0"]
    part = str(tmp_path / "part" / "bars")
    assert main([*asked, "--out", str(tmp_path / "whole")]) == 0
    assert main([*asked, "--seconds", "0.4", "--out", str(tmp_path / "part")]) == 0
    resumed = ["bind", "--resume", part, "--pictures", "0", "--out", str(tmp_path / "rest")]
    assert main(resumed) == 0
    state = same_state(tmp_path / "whole" / "bars", tmp_path / "rest" / "bars")
    assert rows in [int(value) for name, value in state.items() if name.endswith((".steps", ".frames"))]
    found = [json.loads((tmp_path / name / "bars" / "objects.json").read_text()) for name in ("whole", "rest")]
    assert found[0]["objects"] == found[1]["objects"]
    assert found[0]["weights"] == found[1]["weights"]
    capsys.readouterr()
    other = "published" if model != "published" else "foreground"
    resumed = ["bind", str(clip), "--resume", part, "--out", str(tmp_path)]
    refused([*resumed, "--model", other], capsys, model, other)
    if model != "published":
        refused([*resumed, "--set", "rule=hebbian"], capsys, "has no option rule; published", model)


@pytest.mark.parametrize(("key", "value"), [("frames", -1), ("fit", 3), ("set", [1]), ("fps", 1e300), ("unheard", 1)])
def test_options_of_a_kept_run_have_types(
    key: str, value: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    about = {"model": "foreground", "source": "two-bars", "frames": 10, "rate": 100.0}
    (tmp_path / "from" / "others").mkdir(parents=True)
    save_tensors(
        {"a": torch.zeros(1)}, tmp_path / "from/others/state.safetensors", {"run": json.dumps(about | {key: value})}
    )
    refused(["bind", "--resume", str(tmp_path / "from/others"), "--out", str(tmp_path / "out")], capsys, key)


def test_a_file_name_goes_escaped_to_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(["bind", str(tmp_path / "\x1b]0;x\x07.mp4")], capsys, r"\x1b]0;x\x07.mp4")


def test_a_pipe_that_nobody_reads_holds_up_nothing() -> None:
    reader, writer = os.pipe()
    program = (
        "import sys\nfrom ndtorch.cli.streams import unblocked\nsys.stderr = unblocked(sys.stderr)\n"
        "for n in range(20000):\n    print('a line of a report', n, file=sys.stderr)\nprint('done')\n"
    )
    try:
        done = subprocess.run([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=writer, timeout=60)
        assert done.stdout == b"done\n"
        assert os.read(reader, 1 << 16).startswith(b"a line of a report 0\n")
    finally:
        os.close(reader)
        os.close(writer)


@pytest.mark.parametrize("most", [0, 3000])
@pytest.mark.parametrize(
    "typed",
    [
        "bind two-bars --seconds 0.2 --set settle=0.1 --pictures 1 --out {0}",
        "render three-bars {0}/bars.mp4 --seconds 0.2",
    ],
)
def test_a_full_disk_is_one_line_and_leaves_no_half_file(
    typed: str, most: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    try:
        code = main(typed.format(tmp_path).split())
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    err = capsys.readouterr().err
    assert code != 0
    assert "Traceback" not in err
    assert len([line for line in err.splitlines() if line.startswith("error:")]) == 1, err
    whole = [path for path in tmp_path.rglob("*") if path.is_file() and path.suffix != ".rrd"]
    assert [path.name for path in whole if path.stat().st_size >= max(most, 1)] == []


def test_a_full_pipe_does_not_hold_up_the_end(tmp_path: Path) -> None:
    """Nobody reads the result: a signal ends the program, and closed streams do not matter."""
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writer, b"x")
    os.set_blocking(writer, True)
    program = [sys.executable, "-m", "ndtorch", "scenes"]
    with subprocess.Popen(program, stdout=writer, stderr=subprocess.PIPE) as process:
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(3)
        process.terminate()
        assert process.wait(3) == 143
    os.close(reader)
    os.close(writer)
    closed = subprocess.run(["sh", "-c", '"$0" -m ndtorch scenes >&- 2>&- <&-', sys.executable], timeout=60)
    assert closed.returncode == 0
