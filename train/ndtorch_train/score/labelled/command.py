"""`ndtorch score --labelled FOLDER`: the video model and what people use, on video with others' truth."""

from __future__ import annotations

import platform
import time
from collections.abc import Sequence
from pathlib import Path

import cv2
import torch

from ndtorch.errors import InputError
from ndtorch.run.folder import prepare
from ndtorch_train.score.choices import LABELLED
from ndtorch_train.score.labelled.methods import see, shrunk
from ndtorch_train.score.labelled.metrics import score
from ndtorch_train.score.labelled.peers import Subtraction
from ndtorch_train.score.labelled.table import Row, write
from ndtorch_train.score.labelled.truth import Labelled, clip_folders, read_clip

NOTE = (
    "A place is right inside a true box or blob. Processor time of one thread, without decoding, and its ratio to MOG2 "
    "with its contours alone in the same process. Masks and counts over all frames. The model says an object from its "
    "first sighting on, once it is known to be one; the peers say it when they know. {machine}, torch {torch}."
)


def run(folder: Path, methods: Sequence[str], rows: int, out: Path) -> int:
    """Score methods on every clip of a folder, write labelled.csv, labelled.md and index.html.

    Args:
        folder: of folders with clip.mp4, and gt.txt or masks.mkv, or one of them.
        methods: names among `LABELLED`, or folders of models.
        rows: height of the frames; 0 for their own.
        out: where to write.

    Raises:
        InputError: a folder without clips, or an unknown method.
    """
    for name in methods:
        if name not in LABELLED and not Path(name).is_dir():
            raise InputError(f"methods must be among {', '.join(LABELLED)} or folders of models, got {name!r}")
    clips = [read_clip(path) for path in clip_folders(folder)]
    prepare(out)
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    table: list[Row] = []
    note = NOTE.format(machine=platform.machine(), torch=torch.__version__)
    for labelled in clips:
        plain = mog2_seconds(labelled, rows)
        for name in methods:
            seen = see(name, labelled.clip, rows)
            values = score(seen, labelled.truth(), labelled.clip.fps, labelled.kind == "masks")
            table.append(Row(name, labelled.clip.name, values, seen.seconds / max(plain, 1e-9)))
            print(f"{labelled.clip.name}: {name}", flush=True)
            # After every method, so that a run that is stopped leaves what it has.
            write(table, note, out)
    print(write(table, note, out))
    print(f"written  {out}: labelled.csv, labelled.md, index.html")
    return 0


def mog2_seconds(labelled: Labelled, rows: int) -> float:
    """Processor time of MOG2 and its contours over a clip."""
    subtract, seconds = Subtraction("mog2"), 0.0
    for frame in shrunk(labelled.clip, rows):
        began = time.process_time()
        subtract(frame)
        seconds += time.process_time() - began
    return seconds
