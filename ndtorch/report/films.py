"""What is filmed while a run goes on: the enhanced image, the objects marked in the video, a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding import BoundObject
from ndtorch.report.palette import GREY_RGB, STYLES, rgb
from ndtorch.report.recording import Recording
from ndtorch.run.result import over_fields
from ndtorch.run.watchers import Picture, Pixels, Watcher
from ndtorch.scenes.video_writer import VideoWriter
from ndtorch.vision.features import FEATURES

STEP = {"left": (0, -1), "right": (0, 1), "down": (1, 0), "up": (-1, 0)}
"""Rows and columns of an arrow towards a direction."""
YOUNG = 0.3
"""Seconds that a thing has to last before it is marked."""


class EnhancedVideo(Watcher):
    """enhanced.mp4: the input beside its enhanced image."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        self.size = even(size)
        self.writer = VideoWriter(path, fps, (self.size[0], 2 * self.size[1]))

    def picture(self, picture: Picture) -> None:
        height, width = self.size
        assert picture.enhanced is not None
        sides = [torch.from_numpy(image)[:height, :width] for image in (picture.frame, picture.enhanced)]
        self.writer.write(torch.cat(sides, 1).permute(2, 0, 1))

    def close(self) -> None:
        """Finish the file."""
        self.writer.close()


class Overlay(Watcher):
    """overlay.mp4: the video with every object in sight marked."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        self.size = even(size)
        self.writer = VideoWriter(path, fps, self.size)

    def picture(self, picture: Picture) -> None:
        height, width = self.size
        image = marked(picture.frame[:height, :width], picture.objects)
        self.writer.write(torch.from_numpy(image).permute(2, 0, 1))

    def close(self) -> None:
        """Finish the file."""
        self.writer.close()


class MaskFilm(Watcher):
    """mask.mp4: white where an object is, of models with silhouettes; a frame a time step."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        self.size = even(size)
        self.writer = VideoWriter(path, fps, self.size)

    def signals(self, signals: Any, weights: Tensor) -> None:
        import cv2

        for mask in signals.mask.cpu().numpy():
            wide = np.asarray(cv2.resize(mask * np.uint8(255), self.size[::-1], interpolation=cv2.INTER_LINEAR))
            image = np.where(wide > 127, np.uint8(255), np.uint8(0))
            self.writer.write(torch.from_numpy(image).expand(3, *self.size))

    def close(self) -> None:
        """Finish the file."""
        self.writer.close()


class RunRecording(Watcher):
    """Shows a run to a rerun recording."""

    def __init__(self, path: Path) -> None:
        self.recording = Recording(path)

    def picture(self, picture: Picture) -> None:
        if picture.enhanced is None:
            image = marked(picture.frame, picture.objects)
            words = ", ".join(thing.color for thing in picture.objects) or "nothing in sight"
            self.recording.frame(picture.time, picture.frame, image, words)
        else:
            words = f"{FEATURES[picture.winner]} wins" if picture.winner >= 0 else "no winner yet"
            self.recording.frame(picture.time, picture.frame, picture.enhanced, words)

    def signals(self, signals: Any, weights: Tensor) -> None:
        times = signals.time.tolist()
        for at, outputs in zip(times, over_fields(signals.outputs), strict=True):
            self.recording.outputs(at, outputs)
        if times:
            self.recording.weights(times[-1], weights)

    def finish(self, text: str) -> None:
        """Add the table of objects and close the file."""
        self.recording.objects(text)
        self.recording.close()


def even(size: tuple[int, int]) -> tuple[int, int]:
    """The size that codecs take: not more, and even in height and width."""
    return size[0] // 2 * 2, size[1] // 2 * 2


def marked(frame: Pixels, things: tuple[BoundObject, ...]) -> Pixels:
    """The frame `[H, W, 3]` with each object in its colour: its box, or a circle and an arrow where it moves."""
    import cv2

    image = np.ascontiguousarray(frame).copy()
    for thing in things:
        if thing.place is None or (thing.last_seen or 0.0) - (thing.first_seen or 0.0) < YOUNG:
            continue
        color = rgb(thing.color) if thing.color in STYLES else GREY_RGB
        column, row = (round(side) for side in thing.place)
        if thing.box is not None:
            corners = [(round(thing.box[0]), round(thing.box[1])), (round(thing.box[2]), round(thing.box[3]))]
            for ink, width in (((255, 255, 255), 3), (color, 1)):
                cv2.rectangle(image, corners[0], corners[1], ink, width, cv2.LINE_AA)
            continue
        radius = round(0.08 * len(image) * max(1.0, (thing.fields or 1) ** 0.5 / 2))
        down, right = STEP.get(thing.direction or "", (0, 0))
        tip = (column + right * 2 * radius, row + down * 2 * radius)
        for ink, width in (((255, 255, 255), 4), (color, 2)):
            cv2.circle(image, (column, row), radius, ink, width, cv2.LINE_AA)
        for ink, width in (((255, 255, 255), 4), (color, 2)):
            cv2.arrowedLine(image, (column, row), tip, ink, width, cv2.LINE_AA, tipLength=0.35)
    return image
