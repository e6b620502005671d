"""What is printed: nobody has to read it, a terminal obeys none of it, and what went wrong is one line."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from ndtorch.cli.command_run import what_the_system_said
from ndtorch.cli.commands import installed, main
from ndtorch.cli.streams import Unblocked, escaped, line
from ndtorch.utils.packages import toml_file
from tests.command_line import refused
from tests.fuzz.corpus import corpus

WRITES = """
import sys
from ndtorch.cli.streams import unblocked
sys.stderr = unblocked(sys.stderr)
for n in range(100_000):
    print("a line of a report", n, file=sys.stderr)
print("done")
"""


def test_a_pipe_that_nobody_reads_holds_up_nothing() -> None:
    reader, writer = os.pipe()
    try:
        done = subprocess.run([sys.executable, "-c", WRITES], stdout=subprocess.PIPE, stderr=writer, timeout=60)
        assert done.stdout == b"done\n"
        assert os.read(reader, 1 << 16).startswith(b"a line of a report 0\n")
    finally:
        os.close(reader)
        os.close(writer)


def test_what_is_read_again_is_written_again(tmp_path: Path) -> None:
    reader, writer = os.pipe()
    with os.fdopen(writer, "w") as stream:
        out = Unblocked(stream)
        began = time.process_time()
        while out.patience:
            out.write("x" * 4000)
        assert time.process_time() - began < 5
        os.read(reader, 1 << 20)
        out.write("again\n")
        assert os.read(reader, 100) == b"again\n"
        os.close(reader)
        out.write("the reader is gone\n")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain, größer, 東\n\t", "plain, größer, 東\n\t"),
        ("\x1b[2J\x07", r"\x1b[2J\x07"),
        ("\x9b31m\u2028", r"\x9b31m\u2028"),
        ("a\udcff", r"a\udcff"),
    ],
)
def test_control_characters_are_shown_escaped(text: str, shown: str) -> None:
    assert escaped(text) == shown
    assert line("a\nb\x1b") == r"a\nb\x1b"


def test_a_file_name_goes_escaped_to_the_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(["bind", str(tmp_path / "\x1b]0;x\x07.mp4")], capsys, r"\x1b]0;x\x07.mp4")
    film = tmp_path / "\x1b[31m.avi"
    assert main(["render", "one-bar", str(film), "--seconds", "0.05", "--fps", "20"]) == 0
    assert r"\x1b[31m.avi: 1 frames" in capsys.readouterr().out


def test_memory_that_is_short_is_one_line_that_says_what_was_asked_for() -> None:
    with pytest.raises(RuntimeError) as of_torch:
        torch.empty(1 << 60)
    for error, words in (
        (of_torch.value, str(1 << 62)),
        (MemoryError("Unable to allocate 3. GiB for an array"), "3. GiB"),
        (MemoryError(), "not enough memory"),
        (OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)), "not enough memory"),
        (NotADirectoryError(errno.ENOTDIR, "Not a directory", "clip.avi/x.mp4"), "clip.avi/x.mp4: Not a directory"),
    ):
        said = what_the_system_said(error)
        assert said is not None
        assert words in said
        assert "\n" not in said
    assert what_the_system_said(RuntimeError("size mismatch")) is None


def test_what_takes_longer_than_a_day_says_so_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from ndtorch.cli.command_run import told
    from ndtorch.run.progress import tell_if_long

    with told(quiet=False, muted=False):
        tell_if_long(200 * 86400 * 12)
        tell_if_long(1000)
    assert (
        capsys.readouterr().err == "note: 2.07e+08 frames: this takes longer than 12 days even at 200 frames a second\n"
    )


@contextlib.contextmanager
def full_disk(most: int) -> Iterator[None]:
    """No file grows beyond so many bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


SWEEP = 'kind = "binding"\n[vary]\ngamma = [0.5, 5.0]\n[fixed]\nseconds = 0.2\n'

WRITERS = {
    "bind": "bind two-bars --seconds 0.2 --settle 0.1 --pictures 1 --out {out}",
    "bind --rrd": "bind two-bars --seconds 0.2 --settle 0.1 --pictures 0 --rrd {out}/run.rrd --out {out}",
    "render": "render three-bars {out}/bars.mp4 --seconds 0.2",
    "drive": "drive --seconds 0.2 --out {out}",
    "drive --record": "drive --seconds 0.2 --record {out}/r.mcap --out {out}/o",
    "drive --rrd": "drive --seconds 0.2 --rrd {out}/run.rrd --out {out}/o",
    "evaluate": "evaluate --arenas room --seeds 7 --seconds 0.2 --controllers published --jobs 1 --out {out}",
    "barn": "barn {barn} --jobs 1 --controller published --worlds 5 --out {out}",
    "replay": "replay {recording} --rrd {out}/replay.rrd",
    "import": "import {bag} --out {out}/import.mcap",
    "run": "run {car} --go --seconds 0.5 --record {out}/r.mcap",
    "run --save-map": "run {car} --go --seconds 0.5 --save-map {out}/map",
    "first-stage": "first-stage --gamma 50 --out {out}",
    "benchmark scenes": "benchmark scenes --scenes 1 --seconds 0.3 --methods published --out {out}",
    "benchmark ranges": "benchmark ranges {ranges} --disparities 2 8 --jobs 1 --out {out}",
    "reproduce": "reproduce A3 --quick --jobs 1 --out {out}",
    "sweep": "sweep {sweep} --jobs 1 --out {out}",
}
"""Commands that write, as briefly as they can be asked."""

FULL = re.compile("File too large|cannot be written|not whole|cannot be opened for writing|disk was full")

SILENT = {"arenas", "cameras", "check", "doctor", "scenes"}
"""Commands that write nothing."""

ELSEWHERE = {"calibrate"}
"""Needs films of a board: what it writes is tried below."""

QUICK = ("bind", "render")


def test_every_command_is_tried() -> None:
    assert {name.split()[0] for name in WRITERS} | SILENT | ELSEWHERE == set(installed())


def arguments(name: str, out: Path, given: Path) -> list[str]:
    """What is typed, with what it needs."""
    sweep = given / "sweep.toml"
    sweep.write_text(SWEEP)
    car = given / "car.toml"
    text = toml_file(Path("sim"), "ndtorch_robot", "configs").read_text()
    text = (
        text.replace('"hosted-board"', '"simulated-world"')
        .replace("real_time = true\n", "")
        .replace("map_half_size_m = 0.0", "map_half_size_m = 5.0")
    )
    car.write_text(text)
    recording = next(corpus("replay").iterdir())
    places = {"out": out, "car": car, "sweep": sweep, "recording": recording, "barn": corpus("barn") / "worlds.json"}
    places["bag"] = corpus("bag") / "file.mcap"
    pair = given / "ranges" / "pair"
    pair.mkdir(parents=True, exist_ok=True)
    picture = np.random.default_rng(0).integers(0, 256, (24, 64), np.uint8)
    for side, moved in (("left", 0), ("right", -4)):
        cv2.imwrite(str(pair / f"{side}.png"), np.roll(picture, moved, 1))
    cv2.imwrite(str(pair / "disp.tif"), np.full(picture.shape, 4, np.float32))
    return WRITERS[name].format(**places, ranges=pair.parent).split()


def said(lines: str) -> list[str]:
    """What is said of an error: a car that drives on says it with its other lines."""
    told = ("error:", "failed:", "Traceback")
    lists = [line for line in lines.splitlines() if not line.startswith("note:")]
    return [line for line in lists if line.startswith(told) or "has stopped after" in line]


def opens(path: Path) -> bool:
    """Whether a file is whole, for the kinds that tell."""
    if path.suffix == ".json":
        return json.loads(path.read_text()) is not None
    if path.suffix == ".html":
        return path.read_text().rstrip().endswith("</html>")
    if path.suffix in (".mp4", ".avi", ".png"):
        film = cv2.VideoCapture(str(path))
        return bool(film.read()[0])
    return path.stat().st_size > 0


def check(name: str, most: int, tmp_path: Path, capsys: pytest.CaptureFixture[str], room: bool = False) -> None:
    out = tmp_path / "out"
    out.mkdir()
    given = arguments(name, out, tmp_path)
    with full_disk(most):
        code = main(given)
    printed = capsys.readouterr().err
    whole = [path for path in out.rglob("*") if path.is_file() and not path.name.startswith("part-")]
    if code == 0 and room:  # for all that it writes
        assert whole
        for path in whole:
            assert path.stat().st_size < most, path
            assert opens(path), path
        return
    assert code not in (0, None), f"{most}: exit code {code}, {sorted(path.name for path in whole)}\n{printed}"
    assert "Traceback" not in printed
    assert len(said(printed)) == 1, printed
    assert FULL.search(said(printed)[0]), printed
    # What grows while it is recorded: it is read up to its end, or (.rrd) said not to be whole.
    recorded = {".mcap", ".rrd"}
    half = [path.name for path in whole if path.stat().st_size >= most and path.suffix not in recorded]
    assert half == [], "these were cut off"
    shutil.rmtree(out)


@pytest.mark.parametrize("name", QUICK)
def test_a_full_disk(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check(name, 3000, tmp_path, capsys)


@pytest.mark.long
@pytest.mark.parametrize("most", [0, 700, 20_000])
@pytest.mark.parametrize("name", WRITERS)
def test_a_disk_that_is_full_sooner_or_later(
    name: str, most: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    check(name, most, tmp_path, capsys, room=most > 0)
