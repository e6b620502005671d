"""What a user gets who makes a mistake: one line that names what was typed, the exit code 2, and no file.

A case is what is typed after `ndtorch`, in a folder with the files that `prepare` makes, and behind `=>` words that the
answer holds.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from ndtorch.cli.commands import main

CASES = {
    "Commands and options": """
        bnid two-bars => did you mean bind?
        bind two-bars --modle published => did you mean --model?
        bind two-bars --seconds
        bind two-bars --seconds -3
        drive --seed 1.5
    """,
    "Sources, scenes and models": """
        bind two-barz => did you mean two-bars?
        bind clpi.avi => did you mean clip.avi?
        bind text.mp4
        bind void
        bind two-bars --model publishd => did you mean published?
        bind two-bars --model foreground --set rule=hebbian => has no option rule; published
        bind two-bars --model published --set rule=hebian => did you mean hebbian?
        bind clip.avi --fit stretch => no option of foreground
        bind two-bars --set gamma=-1 => greater than or equal to 0
        bind two-bars --set scene.phase=inf
        bind two-bars --device abacus
        bind two-bars --device cpu:7 => there is one cpu
        bind two-bars --device meta => 'meta' cannot be used
        bind two-bars --start 10
        bind two-bars --fit squash => must be one of crop, stretch
        bind clip.avi --set scene.phase=90
        bind two-bars --resume text.mp4
        bind two-bars --out /proc/nothing
        render three-bras x.mp4 => did you mean three-bars?
        render two-bars text.mp4/x.mp4 => Not a directory
        render two-bars void => exists
        render two-bars x.mp4 --seconds 1e300 => --seconds
        render two-bars x.mp4 --fps 1e300 => --fps must be a number from 0 to 100000
    """,
    "Drives": """
        drive --arena halway => did you mean hallway?
        drive --arena nowhere.toml => no such file
        drive --controller rangin => did you mean ranging?
        drive --odometry nosy => did you mean noisy?
        drive --seconds 1e99
        drive --seed -1 => seed must be
        drive --features 0 => features must be a whole number
        drive --feature-position moton => did you mean motion?
        drive --controller goal --goal 90,0
        drive secnods.toml => did you mean seconds?
        drive text.mp4 => not a TOML file
        drive --seconds 1 --rrd /proc/nothing/run.rrd => cannot write the recording
        drive --out /proc/nothing => cannot write there
        evaluate --arenas rom => did you mean room?
        evaluate --controllers gaol => did you mean goal?
        evaluate --seeds => --seeds and --arenas need one value or more
        evaluate --jobs -2 => --jobs must be 1 or more
        evaluate --arenas room --out /proc/nothing => cannot write there
        evaluate nowhere.toml => no such file
        barn worlds.json
        barn worlds.json --split al => did you mean all?
        replay nowhere
    """,
    "A car": """
        run maxston8 => did you mean maxstone8?
        run sim --seconds nan => --seconds must be a number
        run sim --save-map map => --save-map needs a map
        check simm => did you mean sim?
        calibrate void void
        calibrate void void --columns 1
    """,
    "Training, scores and sweeps": """
        first-stage --radius 2
        benchmark over-time --methods scalefree => did you mean scale-free?
        benchmark foreground . --methods mog2-sorted => did you mean mog2-sort?
        sweep bindin => did you mean binding?
        sweep binding --cluster a b
        reproduce BB5 => did you mean B5?
    """,
}
"""What is typed, under headings."""


def cases() -> list[tuple[str, str]]:
    """What is typed, and words of the answer."""
    lines = [line.strip().partition(" => ") for lines in CASES.values() for line in lines.strip().splitlines()]
    return [(typed, words) for typed, _, words in lines]


def prepare(folder: Path) -> None:
    """The files that the cases name."""
    (folder / "void").mkdir()
    (folder / "text.mp4").write_text("this is no video\n")
    writer = cv2.VideoWriter(str(folder / "clip.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for shade in range(20):
        writer.write(np.full((48, 64, 3), 10 * shade, np.uint8))
    writer.release()
    (folder / "secnods.toml").write_text("secnods = 3\n")
    (folder / "worlds.json").write_text('{"worlds": 3}\n')


def said(words: str) -> tuple[int, str]:
    """The exit code of a command, and what it says on stderr."""
    error = io.StringIO()
    with contextlib.redirect_stderr(error), contextlib.redirect_stdout(io.StringIO()):
        try:
            code = main(words.split())
        except SystemExit as end:
            code = int(end.code or 0)
    lines = error.getvalue().replace(f"{Path.cwd()}{os.sep}", "").splitlines(keepends=True)
    return code, "".join(line for line in lines if not line.startswith("note:"))  # of others that compile at once


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    prepare(tmp_path)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("typed", "words"), cases())
def test_a_mistake_is_one_line(typed: str, words: str, tmp_path: Path) -> None:
    before = sorted(tmp_path.rglob("*"))
    code, line = said(typed)
    assert code == 2, line
    assert line.startswith("error: ")
    assert line.count("\n") == 1
    parts = [part.lstrip("-") for part in re.split(r"[\s=,:./]+", typed)]
    assert any(part and part.casefold() in line.casefold().replace("_", "-") for part in parts), line
    assert words in line
    assert sorted(tmp_path.rglob("*")) == before
