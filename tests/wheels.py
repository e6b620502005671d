"""`make wheels`: each of the three wheels, alone in an empty environment, does what it promises and leaves no trace.

Every environment lies outside the checkout and holds only what the wheel asks for, from the package index, with the
versions of constraints.txt. Takes some minutes and a gigabyte each; downloads are kept by pip.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]


class Trial(NamedTuple):
    """A wheel in an environment of its own.

    Attributes:
        name: of the distribution.
        works: command lines that must end well.
        lacks: command lines that must end with code 2 and one line, and what that line names.
        extra: then installed besides, "" for none.
        with_extra: command lines that must end well with it.
    """

    name: str
    works: Sequence[Sequence[str]]
    lacks: Sequence[tuple[Sequence[str], str]]
    extra: str = ""
    with_extra: Sequence[Sequence[str]] = ()


MOVING = """
import cv2, numpy as np, pathlib
pathlib.Path("moving").mkdir(exist_ok=True)
for n in range(60):
    frame = np.full((120, 160, 3), 90, np.uint8)
    frame[::7] = 120
    frame[40:64, 2 * n : 2 * n + 24] = (40, 60, 200)
    cv2.imwrite(f"moving/{n:03}.png", frame)
"""
"""Writes the folder `moving`, a red square that crosses a striped background."""

FILES = (
    ("python", "-c", MOVING),
    ("ndtorch", "render", "two-bars", "bars.mp4", "--seconds", "0.5"),
    ("ndtorch", "bind", "moving", "--pictures", "0"),
    ("ndtorch", "bind", "bars.mp4", "--pictures", "0"),
)
"""Commands that every environment must be able to run: a folder of images and a video with the default model."""

LOAD = "import ndtorch; print([ndtorch.load(name).__class__.__name__ for name in ndtorch.model_names()])"

TRIALS = (
    Trial(
        "ndtorch",
        (
            ("ndtorch", "--help"),
            ("ndtorch", "scenes"),
            ("ndtorch", "bind", "two-bars", "--seconds", "1", "--pictures", "0"),
            ("ndtorch", "bind", "moving", "--model", "scale-free", "--pictures", "0"),
            ("ndtorch", "bind", "moving", "--model", "retinotopic", "--pictures", "0"),
            ("python", "-m", "ndtorch", "scenes"),
            ("python", "-c", LOAD),
        ),
        (
            (("ndtorch", "bind", "--seconds", "1", "--rrd", "run.rrd"), "(of ndtorch[view])"),
            (("ndtorch", "drive"), "pip install ./robot"),
            (("ndtorch", "benchmark"), "pip install ./train"),
        ),
    ),
    Trial(
        "ndtorch-robot",
        (("ndtorch", "--help"), ("ndtorch", "arenas"), ("ndtorch", "cameras")),
        (
            (("ndtorch", "drive", "--seconds", "2"), "(of ndtorch-robot[sim])"),
            (("ndtorch", "evaluate", "--arenas", "room", "--seconds", "1"), "(of ndtorch-robot[sim])"),
        ),
        "sim",
        (
            ("ndtorch", "drive", "--seconds", "2", "--record", "rec.mcap"),
            ("ndtorch", "replay", "rec.mcap"),
            ("ndtorch", "evaluate", "--arenas", "room", "--seconds", "1", "--seeds", "1000", "--jobs", "1"),
        ),
    ),
    Trial(
        "ndtorch-train",
        (
            (
                "ndtorch",
                "benchmark",
                "scenes",
                "--scenes",
                "3",
                "--seconds",
                "2",
                "--methods",
                "published",
                "scale-free",
                "ica",
            ),
            ("ndtorch", "reproduce", "A3", "A9", "--quick"),
            ("ndtorch", "first-stage", "--radius", "0.2"),
            ("ndtorch", "sweep", "small.toml"),
        ),
        ((("ndtorch", "sweep", "small.toml", "--fresh", "--cluster"), "(of ndtorch-train[cluster])"),),
    ),
)


def main() -> int:
    """Build, then try each wheel; returns 0 if all went well."""
    with tempfile.TemporaryDirectory(prefix="wheels-") as scratch:
        wheels = Path(scratch, "wheels")
        places = [str(ROOT), str(ROOT / "robot"), str(ROOT / "train")]
        call([sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(wheels), *places], ROOT)
        wanted = sys.argv[1:]
        for number, trial in enumerate(TRIALS):
            if not wanted or trial.name in wanted:
                try_wheel(trial, wheels, Path(scratch, str(number)))
    print("all wheels work alone")
    return 0


def try_wheel(trial: Trial, wheels: Path, place: Path) -> None:
    """Install a wheel into an empty environment, run it, and take it away again."""
    began = time.monotonic()
    place.mkdir()
    work = place / "work"
    work.mkdir()
    (work / "small.toml").write_text("[vary]\nphase = [60, 290]\n[fixed]\nseconds = 2\n")
    call([sys.executable, "-m", "venv", str(place / "venv")], work)
    binaries = place / "venv" / "bin"
    pip = [str(binaries / "python"), "-m", "pip", "--quiet", "--disable-pip-version-check"]
    empty = files_in(place / "venv")
    options = ["--find-links", str(wheels), "-c", str(ROOT / "constraints.txt")]
    call([*pip, "install", *options, trial.name], work)
    installed = time.monotonic() - began
    size = sum(path.stat().st_size for path in files_in(place / "venv") - empty)
    said = call([str(binaries / "ndtorch"), "--version"], work)
    assert f"{trial.name} " in said, said
    call([*pip, "check"], work)
    names = call(
        [str(binaries / "python"), "-c", "from ndtorch.cli.commands import installed; print(*installed())"], work
    )
    helps = [("ndtorch", name, "--help") for name in names.split()]
    for command in (*helps, *FILES, *trial.works):
        call([str(binaries / command[0]), *command[1:]], work)
    for command, words in trial.lacks:
        refused([str(binaries / command[0]), *command[1:]], words, work)
    if trial.extra:
        call([*pip, "install", *options, f"{trial.name}[{trial.extra}]"], work)
    for command in trial.with_extra:
        call([str(binaries / command[0]), *command[1:]], work)
    ours = [name for name in ("ndtorch", "ndtorch-robot", "ndtorch-train") if f"{name} " in said]
    call([*pip, "uninstall", "--yes", *ours], work)
    left = [path for path in (place / "venv").rglob("*ndtorch*") if "__pycache__" not in path.parts or path.is_file()]
    assert not left, left
    print(
        f"{trial.name:14} installs in {installed:.0f} s ({size / 1e6:.0f} MB), works, goes without a trace", flush=True
    )


def files_in(folder: Path) -> set[Path]:
    """Every file below a folder."""
    return {path for path in folder.rglob("*") if path.is_file() and not path.is_symlink()}


def clean_environment() -> dict[str, str]:
    """The environment without anything that leads to the checkout."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
    return kept | {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


def call(command: Sequence[str], folder: Path) -> str:
    """Run a command that must end well; returns what it says."""
    done = subprocess.run(command, cwd=folder, env=clean_environment(), capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


def refused(command: Sequence[str], words: str, folder: Path) -> None:
    """Run a command that must end with code 2 and one line that holds the words."""
    done = subprocess.run(command, cwd=folder, env=clean_environment(), capture_output=True, text=True, check=False)
    lines = [line for line in done.stderr.splitlines() if "error:" in line]
    if done.returncode != 2 or len(lines) != 1 or words not in lines[0] or "Traceback" in done.stderr:
        raise SystemExit(f"{' '.join(command)}: exit code {done.returncode}, not a line with {words}\n{done.stderr}")


if __name__ == "__main__":
    sys.exit(main())
