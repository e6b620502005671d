"""What is filmed while a run goes on: the enhanced image, the objects marked in the video, a recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding import BoundObject
from ndtorch.report.plots.attention import MOST_GAIN
from ndtorch.report.plots.layout import GREY_RGB, STYLES, rgb
from ndtorch.report.recording import Recording
from ndtorch.report.source_tracks import SourceTracks
from ndtorch.run.result import over_fields
from ndtorch.run.watchers import Picture, Pixels, Watcher
from ndtorch.scenes.video_writer import VideoWriter
from ndtorch.vision.features import FEATURES

STEP = {"left": (0, -1), "right": (0, 1), "down": (1, 0), "up": (-1, 0)}
"""Rows and columns of an arrow towards a direction."""
SMALLEST = 100
"""Rows of a picture that letters are put on."""
FADE = 4.0
"""Seconds after which a bright moment no longer sets the scale."""
LIGHT = 3 * 200
"""Sum of red, green and blue of a color that cannot be told from white."""
HUELESS = {"white": (255, 255, 255), "black": (0, 0, 0)}
"""What is drawn for a thing without a hue; all others are grey."""


class EnhancedVideo(Watcher):
    """enhanced.mp4: the input beside its enhanced image, which is shown as bright as the input.

    The factor follows the brightest enhanced pixel of the last seconds, so that the film does not flicker.
    """

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        self.size = even(size)
        self.writer = VideoWriter(path, fps, (self.size[0], 2 * self.size[1]))
        self.keep, self.brightest = math.exp(-1 / (FADE * fps)), 1.0

    def picture(self, picture: Picture) -> None:
        height, width = self.size
        assert picture.enhanced is not None
        self.brightest = max(self.keep * self.brightest, float(picture.enhanced.max()), 1.0)
        gain = max(1.0, min(float(picture.frame.max()) / self.brightest, MOST_GAIN))
        enhanced = (picture.enhanced * gain).clip(0, 255).astype(np.uint8)
        sides = [clocked(image[:height, :width], picture.time) for image in (picture.frame, enhanced)]
        self.writer.write(torch.from_numpy(np.concatenate(sides, 1)).permute(2, 0, 1))

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
        image = clocked(marked(picture.frame[:height, :width], picture.objects), picture.time)
        self.writer.write(torch.from_numpy(image).permute(2, 0, 1))

    def close(self) -> None:
        """Finish the file."""
        self.writer.close()


def write_mask_film(tracks: SourceTracks, path: Path) -> None:
    """mask.mp4: white where an object is; a frame for every frame of the source, and as large."""
    if len(tracks.frames) == 0:
        return
    size = even(tracks.size)
    steps = np.diff(tracks.times)
    rate = 1 / float(np.median(steps)) if len(steps) and np.median(steps) > 0 else 25.0
    writer = VideoWriter(path, rate, size)
    last = np.searchsorted(tracks.frame, tracks.frames, side="right").tolist()
    for first, end in zip(np.searchsorted(tracks.frame, tracks.frames).tolist(), last, strict=True):
        image = np.zeros(tracks.size, np.uint8)
        for mask in filter(None, map(tracks.mask, range(first, end))):
            height, width = mask.pixels.shape
            image[mask.top : mask.top + height, mask.left : mask.left + width][mask.pixels] = 255
        writer.write(torch.from_numpy(image[: size[0], : size[1]]).expand(3, *size))
    writer.close()


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

    def signals(self, signals: Any, weights: Tensor, state: Any) -> None:
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
    """The frame `[H, W, 3]` with each object in its color: its box, or a circle and an arrow; and its label."""
    import cv2

    image = np.ascontiguousarray(frame).copy()
    for thing in things:
        if thing.place is None:
            continue
        color = rgb(thing.color) if thing.color in STYLES else HUELESS.get(thing.color, GREY_RGB)
        label = f"{mark_of(thing)} {thing.color}".strip()
        column, row = (round(side) for side in thing.place)
        if thing.box is not None:
            corners = [(round(thing.box[0]), round(thing.box[1])), (round(thing.box[2]), round(thing.box[3]))]
            pen = max(1, round(len(image) / 500))
            for ink, width in ((rim(color), 3 * pen), (color, pen)):
                cv2.rectangle(image, corners[0], corners[1], ink, width, cv2.LINE_AA)
            lettered(image, label, corners[0][0], corners[0][1] - 4, color)
            continue
        radius = round(0.08 * len(image) * max(1.0, (thing.fields or 1) ** 0.5 / 2))
        down, right = STEP.get(thing.direction or "", (0, 0))
        tip = (column + right * 2 * radius, row + down * 2 * radius)
        for ink, width in ((rim(color), 4), (color, 2)):
            cv2.circle(image, (column, row), radius, ink, width, cv2.LINE_AA)
        for ink, width in ((rim(color), 4), (color, 2)):
            cv2.arrowedLine(image, (column, row), tip, ink, width, cv2.LINE_AA, tipLength=0.35)
        lettered(image, label, column - radius, row - radius - 4, color)
    return image


def mark_of(thing: BoundObject) -> str:
    """The number of an object that is followed, as in the table."""
    return "" if thing.number is None else f"#{thing.number}"


def rim(color: tuple[int, int, int]) -> tuple[int, int, int]:
    """What a color is drawn on so that it can be seen: black under a light one, white under all others."""
    return (0, 0, 0) if sum(color) > LIGHT else (255, 255, 255)


def clocked(image: Pixels, seconds: float) -> Pixels:
    """A copy of the image `[H, W, 3]` with the time at its lower left."""
    image = np.ascontiguousarray(image).copy()
    lettered(image, f"{seconds:.1f} s", 4, len(image) - 5, (0, 0, 0))
    return image


def lettered(image: Pixels, words: str, column: int, baseline: int, color: tuple[int, int, int]) -> None:
    """Write on the image, in color on a rim, inside the picture; not on one that is too small for letters."""
    import cv2

    if len(image) < SMALLEST:
        return
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, max(0.4, len(image) / 560)
    words = words.replace("°", " deg")
    (wide, tall), _ = cv2.getTextSize(words, font, scale, 1)
    place = (min(max(2, column), max(2, image.shape[1] - wide - 2)), min(max(tall + 2, baseline), len(image) - 3))
    # Thicker letters are wider too, so the rim is the same letters around them.
    around = [(across, down, rim(color)) for across in (-1, 0, 1) for down in (-1, 0, 1)]
    for across, down, ink in (*around, (0, 0, color)):
        cv2.putText(image, words, (place[0] + across, place[1] + down), font, scale, ink, 1, cv2.LINE_AA)
