"""Films and pictures of a run: the enhanced image, the objects marked in the video."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from ndtorch.report.plots import brightened, color_of
from ndtorch.report.tracks import TrackRecord
from ndtorch.run.result import Picture, Pixels, Watcher
from ndtorch.scenes.video_writer import VideoWriter

FADE_S = 4.0
"""After this time a bright moment no longer sets the scale."""
CROP_SIDE, CROPS, POSTER_SIDE = 200, 60, 1280
"""Longest side of the crop of an object and of the poster, pixels, and most objects that are cropped."""


class Film(Watcher):
    """A film of the frames of a run.

    Args:
        path, fps, size: of the film; height and width are made even, as codecs want them.

    Attributes:
        times: of its frames, seconds since the first frame of the source.
    """

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        self.path, self.fps, self.size = path, fps, (size[0] // 2 * 2, size[1] // 2 * 2)
        self.times: list[float] = []
        self.writer = VideoWriter(path, fps, self.size)

    def picture(self, picture: Picture) -> None:
        self.write(picture.frame, picture.time)

    def write(self, image: Pixels, seconds: float) -> None:
        """Add an image `[H, W, 3]`."""
        self.times.append(seconds)
        image = np.ascontiguousarray(image[: self.size[0], : self.size[1]])
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
        enhanced = (np.arange(256) * gain).clip(0, 255).astype(np.uint8)[picture.enhanced]
        self.write(timed(np.concatenate([picture.frame, enhanced], 1), picture.time), picture.time)


def draw_overlay(film: Film, tracks: TrackRecord, folder: Path) -> Pixels | None:
    """Mark the objects in a film of the source: overlay.mp4, poster.jpg, the picture with the most of
    them in it, and objects.jpg, the largest view of each object over its number.

    Returns:
        The poster without marks, None without any picture.
    """
    import av

    if not film.times:
        return None
    overlay, best, poster = Film(folder / "overlay.mp4", film.fps, film.size), -1.0, None
    areas, crops = dict[int, float](), dict[int, Pixels]()
    with av.open(str(film.path)) as container:
        for time, decoded in zip(film.times, container.decode(video=0), strict=False):
            frame, rows = np.asarray(decoded.to_ndarray(format="rgb24"), np.uint8), tracks.rows_at(time)
            image = marked(frame, tracks, rows)
            overlay.write(timed(image, time), time)
            for k in rows:
                (left, top, right, bottom), number = tracks.box[k], int(tracks.track[k])
                area = (right - left) * (bottom - top)
                if area > areas.get(number, 0.0) and (number in crops or len(crops) < CROPS):
                    rim = 0.1 * max(right - left, bottom - top) + 2
                    part = frame[max(0, int(top - rim)) : int(bottom + rim), max(0, int(left - rim)) : int(right + rim)]
                    if part.size:
                        areas[number], crops[number] = area, resized(part, CROP_SIDE)
            total = float(np.sqrt((tracks.box[rows, 2:] - tracks.box[rows, :2]).prod(1)).sum())
            if total + len(rows) > best:
                best, poster = total + len(rows), frame
                write_jpeg(resized(image, POSTER_SIDE), folder / "poster.jpg")
    overlay.close()
    if crops:
        edge, across = CROP_SIDE + 30, min(6, len(crops))
        sheet = np.full((-(-len(crops) // across) * edge, across * edge, 3), 255, np.uint8)
        for n, number in enumerate(sorted(crops)):
            cell = sheet[n // across * edge :, n % across * edge :][:edge, :edge]
            cell[: len(crops[number]), : crops[number].shape[1]] = crops[number]
            put_text(cell, f"object {number}", 2, edge - 8, (40, 40, 40))
        write_jpeg(sheet, folder / "objects.jpg")
    return poster


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


def rgb(name: str) -> tuple[int, int, int]:
    """A color of `color_of` as three values in 0..255."""
    red, green, blue = bytes.fromhex(color_of(name)[1:])
    return red, green, blue


def marked(frame: Pixels, tracks: TrackRecord, rows: Sequence[int]) -> Pixels:
    """The frame `[H, W, 3]` with the box, or a circle, of each object in its color; and its number and color."""
    import cv2

    image = np.ascontiguousarray(frame).copy()
    pen = max(1, round(len(image) / 500))
    for k in rows:
        thing, radius = tracks.objects[int(tracks.track[k])], round(0.08 * len(image))
        left, top, right, bottom = map(round, tracks.box[k].tolist())
        color = rgb(thing.color)
        for ink, width in ((contrasting(color), 3 * pen), (color, pen)):
            if tracks.boxed:
                cv2.rectangle(image, (left, top), (right, bottom), ink, width, cv2.LINE_AA)
            else:
                cv2.circle(image, (left, top), radius, ink, width, cv2.LINE_AA)
        above = 0 if tracks.boxed else radius
        put_text(image, f"#{thing.number} {thing.color}", left - above, top - above - 4, color)
    return image


def timed(image: Pixels, seconds: float) -> Pixels:
    """A copy of an image `[H, W, 3]` with the time at its lower left."""
    image = np.ascontiguousarray(image).copy()
    put_text(image, f"{seconds:.1f} s", 4, len(image) - 5, (0, 0, 0))
    return image


def contrasting(color: tuple[int, int, int]) -> tuple[int, int, int]:
    """Black for a light color, white for all others: what a color is drawn on."""
    red, green, blue = color
    return (0, 0, 0) if 0.3 * red + 0.59 * green + 0.11 * blue > 150 else (255, 255, 255)


def put_text(image: Pixels, text: str, column: int, bottom: int, color: tuple[int, int, int]) -> None:
    """Write on an image, in color on a plate, inside the picture; not on one of fewer than 100 rows."""
    import cv2

    if len(image) < 100:
        return
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, max(0.4, len(image) / 560)
    (wide, tall), _ = cv2.getTextSize(text, font, scale, 1)
    right, lowest = max(2, image.shape[1] - wide - 2), len(image) - tall // 3 - 1
    x, y = min(max(2, column), right), min(max(tall + 2, bottom - tall // 3), lowest)
    low, high = (x - 2, y + tall // 3), (x + wide + 2, y - tall - 2)
    cv2.rectangle(image, low, high, contrasting(color), -1)
    cv2.putText(image, text, (x, y), font, scale, color, 1, cv2.LINE_AA)
