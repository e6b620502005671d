"""Mistakes that a user can make.

A case is what is typed after `ndtorch`, in a folder with the files that `prepare` makes.
"""

from __future__ import annotations

import contextlib
import io
import os
from pathlib import Path

import cv2
import numpy as np

from ndtorch.cli.commands import main

CASES = {
    "Commands and options": """
        bnid two-bars
        bind two-bars extra
        bind two-bars --modle published
        bind two-bars --seconds
        bind two-bars --seconds ten
        bind two-bars --seconds -3
        bind --start 1.5
        drive --seeds 3
        drive --seed 1.5
        evaluate --seeds a b
        render
        sweep
        run
        benchmark scenes --json=yes
    """,
    "Sources, scenes and models": """
        bind two-barz
        bind clpi.avi
        bind nowhere/at-all.mp4
        bind empty.mp4
        bind text.mp4
        bind one.png
        bind sizes
        bind void
        bind camera:x
        bind two-bars --model publishd
        bind two-bars --model foregroun
        bind two-bars --model ./void
        bind two-bars --model foreground --rule hebbian
        bind two-bars --rule hebian
        bind two-bars --mask
        bind two-bars --gamma -1
        bind two-bars --gamma nan
        bind two-bars --order last
        bind two-bars --seconds nan
        bind two-bars --fps -5
        bind two-bars --phase inf
        bind two-bars --first-stage-radius 1.5
        bind two-bars --device abacus
        bind two-bars --start 10
        bind two-bars --fit squash
        bind clip.avi --phase 90
        bind clip.avi --start 500
        bind clip.avi --fps 0
        bind two-bars --pictures -1
        bind two-bars --front-end on
        bind two-bars --resume text.mp4
        bind two-bars --out text.mp4
        bind two-bars --out /proc/nothing
        render three-bras x.mp4
        render two-bars x.gif
        render two-bars text.mp4
        render two-bars x.mp4 --seconds 0
    """,
    "Drives": """
        drive --arena halway
        drive --arena bad.toml
        drive --arena nowhere.toml
        drive --controller rangin
        drive --controller pid
        drive --odometry nosy
        drive --walls blnk
        drive --seconds 0
        drive --seconds 1e99
        drive --seed -1
        drive --features 0
        drive --feature-position moton
        drive --compiled
        drive --goal 3
        drive --controller goal --goal 90,0
        drive secnods.toml
        drive kind.toml
        drive nowhere.toml
        drive --out text.mp4
        evaluate --arenas rom
        evaluate --controllers gaol
        evaluate --walls blnk
        evaluate --seeds
        evaluate --jobs -2
        barn worlds.json
        barn text.mp4
        replay void
        replay nowhere
    """,
    "A car": """
        run maxston8
        run car.toml
        run sim --seconds -1
        check simm
        calibrate void void
        calibrate nowhere also-nowhere
        calibrate void void --columns 1
        calibrate void void --square-mm 0
        cameras nowhere.mp4 nowhere.mp4
    """,
    "Training, scores and sweeps": """
        first-stage --gamma 0
        first-stage --radius 2
        benchmark scenes --methods scalefree
        benchmark scenes --seconds 1000
        benchmark hard --scenes -1
        benchmark scenes --split tuen
        benchmark foreground void
        benchmark foreground . --methods mog2-norfare
        sweep bindin
        sweep gama.toml
        sweep binding --jobs 0
        sweep binding --cluster a b
        reproduce BB5
        reproduce --jobs -1
        reproduce A3 --clip nowhere.mp4
    """,
}
"""What is typed, under headings."""


def cases() -> list[str]:
    """All of them."""
    return [line.strip() for lines in CASES.values() for line in lines.strip().splitlines()]


def prepare(folder: Path) -> None:
    """The files that the cases name."""
    for name in ("void", "sizes"):
        (folder / name).mkdir()
    (folder / "empty.mp4").write_bytes(b"")
    (folder / "text.mp4").write_text("this is no video\n")
    for number, size in enumerate((48, 64)):
        cv2.imwrite(str(folder / "sizes" / f"{number}.png"), np.zeros((size, size, 3), np.uint8))
    cv2.imwrite(str(folder / "one.png"), np.zeros((48, 48, 3), np.uint8))
    writer = cv2.VideoWriter(str(folder / "clip.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 48))
    for shade in range(20):
        writer.write(np.full((48, 64, 3), 10 * shade, np.uint8))
    writer.release()
    (folder / "secnods.toml").write_text("secnods = 3\n")
    (folder / "kind.toml").write_text('seconds = "three"\n')
    (folder / "bad.toml").write_text("rooms = [[0, 0, 4]]\n")
    (folder / "car.toml").write_text("[limmits]\nspeed = 1\n")
    (folder / "gama.toml").write_text("[vary]\ngama = [1]\n")
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
