"""Films and pictures of a run, made while it goes on: the enhanced image, the objects marked in the video."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch

from ndtorch.binding import BoundObject
from ndtorch.report.plots import STYLES, brightened
from ndtorch.run.result import Picture, Pixels, Watcher
from ndtorch.scenes.video_writer import VideoWriter
from ndtorch.vision.features import FEATURES

STEP = {"left": (-1, 0), "right": (1, 0), "down": (0, 1), "up": (0, -1)}
"""Columns and rows of an arrow towards a direction."""
FADE_S = 4.0
"""After this time a bright moment no longer sets the scale."""
CROP_SIDE, CROPS, POSTER_SIDE = 200, 60, 1280
"""Longest side of the crop of an object and of the poster, pixels, and most objects that are cropped."""


class Film(Watcher):
    """A film of the pictures of a run.

    Args:
        path, fps, size: of the film; height and width are made even, as codecs want them.
    """

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        self.size = size[0] // 2 * 2, size[1] // 2 * 2
        self.writer = VideoWriter(path, fps, self.size)

    def write(self, image: Pixels, seconds: float) -> None:
        """Add an image `[H, W, 3]` with the time at its lower left."""
        image = np.ascontiguousarray(image[: self.size[0], : self.size[1]]).copy()
        put_text(image, f"{seconds:.1f} s", 4, len(image) - 5, (0, 0, 0))
        self.writer.write(torch.from_numpy(image).permute(2, 0, 1))

    def close(self) -> None:
        self.writer.close()


class EnhancedVideo(Film):
    """enhanced.mp4: the input beside its enhanced image, which is shown as bright as the input.

    The factor follows the brightest enhanced pixel of the last seconds, so that the film does not flicker.
    """

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        super().__init__(path, fps, (size[0], 2 * size[1]))
        self.keep, self.brightest = math.exp(-1 / (FADE_S * fps)), 1.0

    def picture(self, picture: Picture) -> None:
        assert picture.enhanced is not None
        self.brightest = max(self.keep * self.brightest, float(picture.enhanced.max()), 1.0)
        gain = brightened(np.array([self.brightest], np.uint8), float(picture.frame.max()))[1]
        enhanced = (picture.enhanced * gain).clip(0, 255).astype(np.uint8)
        self.write(np.concatenate([picture.frame, enhanced], 1), picture.time)


class Overlay(Film):
    """overlay.mp4: the video with every object in sight marked."""

    def picture(self, picture: Picture) -> None:
        self.write(marked(picture.frame, picture.objects), picture.time)


class Gallery(Watcher):
    """The picture with the most of the objects in it, and the largest view of each object.

    Attributes:
        poster: that picture, objects marked, and without; None before any.
        crops: views by number of object.
    """

    def __init__(self) -> None:
        self.crops = dict[int, Pixels]()
        self.poster: tuple[Pixels, Pixels] | None = None
        self._areas = dict[int, float]()
        self._best = -1.0

    def picture(self, picture: Picture) -> None:
        total = 0.0
        for thing in picture.objects:
            if thing.box is None or thing.number is None:
                continue
            left, top, right, bottom = thing.box
            area = (right - left) * (bottom - top)
            total += area**0.5
            if area > self._areas.get(thing.number, 0.0) and (thing.number in self.crops or len(self.crops) < CROPS):
                rim = 0.1 * max(right - left, bottom - top) + 2
                rows = slice(max(0, int(top - rim)), max(1, int(bottom + rim)))
                columns = slice(max(0, int(left - rim)), max(1, int(right + rim)))
                self._areas[thing.number] = area
                self.crops[thing.number] = resized(picture.frame[rows, columns], CROP_SIDE)
        if total > self._best:
            self._best, self.poster = total, (marked(picture.frame, picture.objects), picture.frame)

    def write(self, folder: Path) -> None:
        """Write poster.jpg, and objects.jpg: six views in a row, each over the number of its object."""
        if self.poster is not None:
            write_jpeg(resized(self.poster[0], POSTER_SIDE), folder / "poster.jpg")
        edge, views = CROP_SIDE + 30, []
        for number in sorted(self.crops):
            view = np.full((edge, edge, 3), 255, np.uint8)
            crop = self.crops[number]
            view[: len(crop), : crop.shape[1]] = crop
            put_text(view, f"object {number}", 2, edge - 8, (40, 40, 40))
            views.append(view)
        if views:
            across = min(6, len(views))
            views += [np.full_like(views[0], 255)] * (-len(views) % across)
            rows = [np.concatenate(views[k : k + across], 1) for k in range(0, len(views), across)]
            write_jpeg(np.concatenate(rows), folder / "objects.jpg")


def resized(image: Pixels, longest: int) -> Pixels:
    """A copy of an image of which no side is longer than that; small ones are enlarged up to four times."""
    import cv2

    scale = min(4.0 if longest == CROP_SIDE else 1.0, longest / max(image.shape[:2]))
    size = max(1, round(image.shape[1] * scale)), max(1, round(image.shape[0] * scale))
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(np.ascontiguousarray(image), size, interpolation=how), dtype=np.uint8)


def write_jpeg(image: Pixels, path: Path) -> None:
    """Write red, green and blue `[H, W, 3]` as a JPEG file."""
    import cv2

    _, data = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, 88])
    path.write_bytes(data.tobytes())


def rgb(feature: str | int) -> tuple[int, int, int]:
    """Color of a feature, by name or number, as three values in 0..255; grey for what is none."""
    name = FEATURES[feature] if isinstance(feature, int) else feature
    if name not in STYLES:
        level = {"white": 255, "black": 0}.get(name, 136)
        return level, level, level
    red, green, blue = bytes.fromhex(STYLES[name].color[1:])
    return red, green, blue


def marked(frame: Pixels, things: tuple[BoundObject, ...]) -> Pixels:
    """The frame `[H, W, 3]` with each object in its color: its box, or a circle and an arrow; and its label."""
    import cv2

    image = np.ascontiguousarray(frame).copy()
    pen = max(1, round(len(image) / 500))
    for thing in things:
        if thing.place is None:
            continue
        color = rgb(thing.color)
        x, y = (round(side) for side in thing.place)
        radius = round(0.08 * len(image) * max(1.0, (thing.fields or 1) ** 0.5 / 2))
        left, top, right, bottom = map(round, thing.box or (x - radius, y - radius, x + radius, y + radius))
        across, down = STEP.get(thing.direction or "", (0, 0))
        for ink, width in ((contrasting(color), 3 * pen), (color, pen)):
            if thing.box is not None:
                cv2.rectangle(image, (left, top), (right, bottom), ink, width, cv2.LINE_AA)
            else:
                cv2.circle(image, (x, y), radius, ink, width, cv2.LINE_AA)
                tip = x + 2 * radius * across, y + 2 * radius * down
                cv2.arrowedLine(image, (x, y), tip, ink, width, cv2.LINE_AA, tipLength=0.35)
        label = thing.color if thing.number is None else f"#{thing.number} {thing.color}"
        put_text(image, label, left, top - 4, color)
    return image


def contrasting(color: tuple[int, int, int]) -> tuple[int, int, int]:
    """Black for a light color, white for all others: the rim that a color is drawn on."""
    return (0, 0, 0) if sum(color) > 3 * 200 else (255, 255, 255)


def put_text(image: Pixels, text: str, column: int, baseline: int, color: tuple[int, int, int]) -> None:
    """Write on an image, in color on a rim, inside the picture; not on one of fewer than 100 rows."""
    import cv2

    if len(image) < 100:
        return
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, max(0.4, len(image) / 560)
    (wide, tall), _ = cv2.getTextSize(text, font, scale, 1)
    place = (min(max(2, column), max(2, image.shape[1] - wide - 2)), min(max(tall + 2, baseline), len(image) - 3))
    for ink, width in ((contrasting(color), 3), (color, 1)):
        cv2.putText(image, text, place, font, scale, ink, width, cv2.LINE_AA)
