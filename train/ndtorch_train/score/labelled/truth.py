"""Readers of truth: boxes with identities (gt.txt in MOT format), or masks (masks.mkv)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from ndtorch.errors import InputError
from ndtorch_train.score.labelled.sight import Box, Clip, Mask, Pixels

MOVING, IGNORED = 200, 100
"""A mask's grey value from which on a pixel moves, and from which on it is not counted."""
SMALLEST = 0.0005
"""Smallest true blob, as a share of the picture."""
AROUND = 3
"""Pixels around a true blob that count as inside."""


class Real(Protocol):
    """One true object at one frame; None of the identity where it is not known."""

    @property
    def identity(self) -> int | None: ...

    def holds(self, column: float, row: float) -> bool:
        """Whether a place is inside."""


@dataclass(frozen=True)
class RealBox:
    """A true box."""

    identity: int | None
    box: Box

    def holds(self, column: float, row: float) -> bool:
        """Whether a place is inside."""
        return self.box.left <= column <= self.box.right and self.box.top <= row <= self.box.bottom


@dataclass(frozen=True)
class RealBlob:
    """A connected blob of a true mask, number `label` of `labels`."""

    labels: np.ndarray[tuple[int, ...], np.dtype[np.int32]]
    label: int
    identity: int | None = None

    def holds(self, column: float, row: float) -> bool:
        """Whether a place is inside."""
        height, width = self.labels.shape
        at = (min(height - 1, max(0, int(row))), min(width - 1, max(0, int(column))))
        return bool(self.labels[at] == self.label)


@dataclass(frozen=True)
class RealFrame:
    """The truth of one frame: its objects, and where masks are known what moves and which pixels count."""

    things: list[Real]
    moving: Mask | None = None
    counted: Mask | None = None


@dataclass(frozen=True)
class Labelled:
    """A clip with truth: kind is "boxes", "masks" or "none"."""

    clip: Clip
    kind: str
    folder: Path

    def truth(self) -> Iterator[RealFrame]:
        """The truth, frame by frame; nothing is there in a clip without truth."""
        if self.kind == "boxes":
            return boxes(self.folder / "gt.txt")
        if self.kind == "masks":
            return blobs(self.folder / "masks.mkv", self.clip.size)
        return iter(())


class Frames:
    """The frames of a file; every loop over them reads it again."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __iter__(self) -> Iterator[Pixels]:
        import cv2

        capture = cv2.VideoCapture(str(self.path))
        try:
            while True:
                there, frame = capture.read()
                if not there:
                    return
                yield np.asarray(frame, np.uint8)
        finally:
            capture.release()


def read_clip(folder: Path) -> Labelled:
    """The clip in a folder with `clip.mp4`, and `gt.txt` or `masks.mkv`; with neither, nothing moves in it.

    Raises:
        InputError: no clip, or one that cannot be read.
    """
    import cv2

    path = folder / "clip.mp4"
    if not path.is_file():
        raise InputError(f"{folder} holds no clip.mp4")
    capture = cv2.VideoCapture(str(path))
    fps, width, height = (capture.get(k) for k in (cv2.CAP_PROP_FPS, 3, 4))
    capture.release()
    if not (fps > 0 and width and height):
        raise InputError(f"{path} is not a video that can be decoded")
    kind = "boxes" if (folder / "gt.txt").exists() else "masks" if (folder / "masks.mkv").exists() else "none"
    return Labelled(Clip(folder.name, Frames(path), fps, (int(height), int(width))), kind, folder)


def clip_folders(folder: Path) -> list[Path]:
    """The folders of clips in a folder, or itself if it is one.

    Raises:
        InputError: none there.
    """
    if (folder / "clip.mp4").is_file():
        return [folder]
    found = sorted(path.parent for path in folder.glob("*/clip.mp4"))
    if not found:
        raise InputError(f"{folder} holds no folder with a clip.mp4")
    return found


def boxes(path: Path) -> Iterator[RealFrame]:
    """Frames of a file in MOT format: frame from 1, identity, left, top, width, height, and 0 for what is not to be
    counted. After its last line nothing is there, for ever.

    Raises:
        InputError: not such a file.
    """
    try:
        rows = np.loadtxt(path, delimiter=",", ndmin=2)
    except ValueError:
        raise InputError(f"{path} is not in MOT format: numbers between commas") from None
    if rows.size and rows.shape[1] < 6:
        raise InputError(f"{path} must have at least six columns, got {rows.shape[1]}")
    if not np.isfinite(rows).all():
        raise InputError(f"{path} must hold finite numbers")
    by_frame: dict[int, list[Real]] = {}
    for row in rows.tolist():
        if len(row) < 7 or row[6]:
            box = Box(row[2], row[3], row[2] + row[4], row[3] + row[5])
            by_frame.setdefault(int(row[0]), []).append(RealBox(int(row[1]), box))
    number = 0
    while True:
        number += 1
        yield RealFrame(by_frame.get(number, []))


def blobs(path: Path, size: tuple[int, int]) -> Iterator[RealFrame]:
    """Frames of a film of masks, their connected blobs as objects."""
    import cv2

    for frame in Frames(path):
        grey = frame[..., 0]
        moving = grey > MOVING
        wide = cv2.dilate(moving.astype(np.uint8), np.ones((2 * AROUND + 1,) * 2, np.uint8))
        count, labels = cv2.connectedComponents(wide)
        areas = np.bincount(labels[moving], minlength=count)
        enough = SMALLEST * size[0] * size[1]
        things: list[Real] = [RealBlob(np.asarray(labels), k) for k in range(1, count) if areas[k] >= enough]
        yield RealFrame(things, moving, moving | (grey < IGNORED))
