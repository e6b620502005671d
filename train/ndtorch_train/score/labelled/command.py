"""`ndtorch score --labelled FOLDER`: the video model and what people use, on video with others' truth."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import torch

from ndtorch.errors import InputError
from ndtorch.nearest import meant
from ndtorch_train.score.choices import LABELLED
from ndtorch_train.score.labelled.methods import see, shrunk
from ndtorch_train.score.labelled.metrics import score
from ndtorch_train.score.labelled.peers import Subtraction
from ndtorch_train.score.labelled.table import Row, write
from ndtorch_train.score.labelled.truth import Labelled, clip_folders, read_clip
from ndtorch_train.score.report import read_rows

NOTE = (
    "A place is right inside a true box or blob. Processor time of one thread, without decoding, and its ratio to MOG2 "
    "with its contours alone in the same process. Masks and counts over all frames. The model says an object from its "
    "first sighting on, once it is known to be one; the peers say it when they know. {machine}, torch {torch}."
)


class Comparison:
    """Score methods on clips; call it with a folder for labelled.csv, labelled.md and report.html.

    Args:
        clips: to score on.
        methods: names among `LABELLED`, or folders of models.
        rows: height of the frames; 0 for their own.
        told: is told how far it is.

    Raises:
        InputError: an unknown method, or rows that are none.
    """

    def __init__(
        self, clips: Sequence[Labelled], methods: Sequence[str], rows: int, told: Callable[[str], None]
    ) -> None:
        check_methods(methods, rows)
        self.clips, self.methods, self.rows, self.told = clips, methods, rows, told

    def __call__(self, out: Path) -> tuple[list[dict[str, Any]], str]:
        """Write the table; returns its rows, and the words to print."""
        cv2.setNumThreads(1)
        table: list[Row] = []
        note = NOTE.format(machine=platform.machine(), torch=torch.__version__)
        for labelled in self.clips:
            plain = mog2_seconds(labelled, self.rows)
            for name in self.methods:
                seen = see(name, labelled.clip, self.rows)
                values = score(seen, labelled.truth(), labelled.clip.fps, labelled.kind == "masks")
                table.append(Row(name, labelled.clip.name, values, seen.seconds / max(plain, 1e-9)))
                self.told(f"{labelled.clip.name}: {name}")
                # After every method, so that a run that is stopped leaves what it has.
                write(table, note, out)
        text = write(table, note, out)
        return read_rows(out / "labelled.csv"), text


def check_methods(methods: Sequence[str], rows: int) -> None:
    """What can be known to be wrong before a clip is looked for.

    Raises:
        InputError: an unknown method, or rows that are none.
    """
    if rows != 0 and rows < 32:
        raise InputError(f"rows must be 0 or at least 32, got {rows}")
    for name in methods:
        if name not in LABELLED and not Path(name).is_dir():
            hint = meant(name, LABELLED)
            raise InputError(f"methods must be among {', '.join(LABELLED)} or folders of models, got {name!r}{hint}")


def labelled_clips(folder: Path) -> list[Labelled]:
    """The clips of a folder of folders with clip.mp4, and gt.txt or masks.mkv, or of one of them.

    Raises:
        InputError: none there, or one that cannot be read.
    """
    return [read_clip(path) for path in clip_folders(folder)]


def mog2_seconds(labelled: Labelled, rows: int) -> float:
    """Processor time of MOG2 and its contours over a clip."""
    subtract, seconds = Subtraction("mog2"), 0.0
    for frame in shrunk(labelled.clip, rows):
        began = time.process_time()
        subtract(frame)
        seconds += time.process_time() - began
    return seconds
