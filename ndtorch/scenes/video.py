"""Video, image folders and cameras as a source of frames."""

from __future__ import annotations

import logging
import math
import os
import warnings
from array import array
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Literal, Self

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import check_size, is_finite, is_whole
from ndtorch.errors import InputError
from ndtorch.scenes.base import FrameSource, PixelMap, SourceFrames, check_chunks
from ndtorch.scenes.readers import (
    FASTEST,
    IMAGE_SUFFIXES,
    FileReader,
    Image,
    ImagesReader,
    LiveReader,
    Reader,
    StampedFrame,
)
from ndtorch.utils.files import readable

log = logging.getLogger(__name__)
Fit = Literal["crop", "stretch", "reduce"]
JUMP_S, JUMP_INTERVALS, BACK_S = 10.0, 50, 1.0
"""Seconds, and frame intervals, between two frames that are a gap in the recording; seconds back that begin another."""


def open_video(
    source: int | str | Path,
    size: tuple[int, int] = (500, 500),
    fps: float | None = None,
    start: int | None = None,
    stop: int | None = None,
    fit: Fit = "crop",
    every: int = 1,
) -> VideoSource:
    """Open a video file, a folder of images, a camera or a stream, and decode its first frame.

    Args:
        source: a file; a folder of images in natural order; a camera as a number, as "camera:0" or as /dev/video0; or
            an address with "://", which is one film or stream: playlists and redirects are refused.
        size: height and width of the frames delivered; with "reduce" only the height counts.
        fps: frames a second where the source has no time stamps or wrong ones. A folder has 30 otherwise. Without it,
            the frames of a file come by their own time stamps, so that those of a variable rate come at a constant one.
        start, stop: the first frame of the source and the one after the last; None for all of it.
        fit: "crop" scales until the image covers `size` and cuts off what sticks out; "stretch" scales both
            sides separately; "reduce" keeps the whole image and its aspect (within the rounding of the width to a
            multiple of 8), is quicker, and never enlarges: fewer rows than `size` asks for come as they are.
        every: deliver the first of so many frames, at a rate so much lower.

    Returns:
        A source of frames `[T, 3, H, W]` uint8, red, green and blue.

    Raises:
        InputError: a source that is missing, empty, unreadable or not a video, a rate that is not in
            0..10 000 Hz while `fps` is not given, or `size`, `fps`, `start`, `stop`, `fit` or `every` out of range.
    """
    check_size("size", size, 1)
    if fit not in ("crop", "stretch", "reduce"):
        raise InputError(f"fit must be 'crop', 'stretch' or 'reduce', got {fit!r}")
    if fps is not None and not (is_finite(fps) and fps > 0):
        raise InputError(f"fps must be a positive number of frames per second, got {repr(fps)[:40]}")
    first = 0 if start is None else start
    if not is_whole(first) or first < 0 or (stop is not None and not (is_whole(stop) and stop > first)):
        given = f"{repr(start)[:40]} and {repr(stop)[:40]}"
        raise InputError(f"start and stop must be frame numbers with 0 <= start < stop, got {given}")
    if not (is_whole(every) and every >= 1):
        raise InputError(f"every must be a number of frames from 1, got {every}")
    reader, name = open_reader(source)
    try:
        if fps is not None:
            reader.timed = False
            reader.fps, reader.notes = fps, [line for line in reader.notes if "--fps" not in line]
        elif not 0 < reader.fps <= FASTEST:
            raise InputError(f"fps must be given for {source}, which declares {reader.fps:g} frames per second")
        if reader.count is not None and max(first + 1, stop or 0) > reader.count:
            raise InputError(f"start and stop must lie within the {reader.count} frames, got {start} and {stop}")
        if first and not reader.live and next(islice(reader.read(), first, None), None) is None:
            raise InputError(f"start must be a frame that can be decoded, got {start}: {source} ends before it")
        return VideoSource(reader, name, size, first, stop, fit, every)
    except InputError:
        reader.close()
        raise


def open_reader(source: int | str | Path) -> tuple[Reader, str]:
    """The reader of a source, and a name for it."""
    if isinstance(source, str) and source.startswith("camera:"):
        number = source.removeprefix("camera:")
        if not number.isdecimal():
            raise InputError(f"source must name a camera as camera:0, got {source!r}")
        source = int(number)
    if isinstance(source, bool) or not isinstance(source, int | str | Path):
        raise InputError(f"source must be a path, a camera's number or an address, got {type(source).__name__}")
    if isinstance(source, int):
        if source < 0:
            raise InputError(f"source must be a camera number >= 0, got {source}")
        return LiveReader(source), f"camera-{source}"
    if isinstance(source, str) and "://" in source:
        return LiveReader(source), source.rstrip("/").rsplit("/", 1)[-1]
    path = Path(source)
    if not os.path.exists(path):  # noqa: PTH110 - of a name that no path can have, `Path` raises
        where = "is a link to a file that is not there" if os.path.islink(path) else "does not exist"  # noqa: PTH114
        raise InputError(f"video {path} {where}")
    if path.is_char_device() and path.name.startswith("video"):
        return LiveReader(str(path)), path.name
    if path.is_dir():
        return ImagesReader(path), readable(path.resolve().name)
    if path.suffix.lower() in IMAGE_SUFFIXES:
        raise InputError(f"{path} is one image: a video or a folder of images is needed")
    return FileReader(path), readable(path.stem)


class VideoSource(FrameSource):
    """Frames of real video; made by `open_video`. Usable in a `with` statement.

    Where a reading ends before the number of frames that the source has, `length` becomes what could be decoded.
    """

    def __init__(
        self, reader: Reader, name: str, size: tuple[int, int], start: int, stop: int | None, fit: Fit, every: int
    ) -> None:
        for line in reader.notes:
            log.info(line)
        if reader.stretch is not None:
            warnings.warn(f"video {name} has more than eight bits: {reader.stretch}", stacklevel=3)
        if fit == "reduce":
            rows = min(size[0], reader.size[0])
            size = (rows, max(8, round(rows * reader.size[1] / reader.size[0] / 8) * 8))
        self.name, self.fps, self.size = name, float(reader.fps) / every, size
        self.silent = ""
        height, width = reader.size
        scale = max(size[0] / height, size[1] / width)
        self._wide = (round(height * scale), round(width * scale)) if fit == "crop" else size
        top, left = self._corner = round((self._wide[0] - size[0]) / 2), round((self._wide[1] - size[1]) / 2)
        down, across = height / self._wide[0], width / self._wide[1]
        self.pixel_map = PixelMap(across, down, left * across, top * down)
        self._latest: list[Image] = []
        self._reader, self._start, self._stop, self._every, self._fit = reader, start, stop, every, fit
        self._grey_noted = self._closed = False
        self._skip = start if reader.live else 0
        self._log = array("d")
        end = reader.count if stop is None else stop
        if start == 0 and stop is None and reader.timed and reader.stamps:
            nothing = np.zeros((0, 0), np.uint8)
            end = sum(1 for _ in paced((StampedFrame(nothing, s) for s in reader.stamps), reader.fps, array("d")))
        self.length = None if end is None else -(-(end - start) // every)

    @property
    def full_size(self) -> tuple[int, int]:
        return self._reader.size

    @property
    def decoded(self) -> SourceFrames:
        stamps, ticks = np.array(self._log).reshape(-1, 2).T
        return SourceFrames(stamps, ticks / self._every, self._reader.names)

    def latest(self) -> list[Image]:
        return [_rgb(image) for image in self._latest]

    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[Tensor]:
        """Yield `[T, 3, H, W]` uint8 with T <= `frames`, from frame `start` of this source to its end.

        A camera goes on where it is, so `start` must be 0 there. A file is decoded from its beginning to
        reach `start`.

        Raises:
            InputError: `frames` below 1, `start` below 0 or not 0 for a camera, or the source is closed; in
                the course of reading, an image of a folder that cannot be decoded.
        """
        check_chunks(frames, start)
        if self._closed:
            raise InputError(f"video {self.name} is closed")
        if self._reader.live and start:
            raise InputError(f"start must be 0, as {self.name} is live, got {start}")
        return self._chunks(frames, start)

    def close(self) -> None:
        """Close the camera or file; reading afterwards is an error."""
        self._closed = True
        self._reader.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _chunks(self, frames: int, start: int) -> Iterator[Tensor]:
        log = self._log = array("d")
        self.cuts = ()
        every, reader = self._every, self._reader
        first = self._skip if reader.live else self._start
        self._skip = 0
        images = paced(islice(reader.read(), self._stop), reader.fps, log, reader.timed, first, self._note_jump)
        images = islice(images, start * every, None, every)
        while large := list(islice(images, frames)):
            self._latest = large if reader.stretch is None else [reader.stretch(image) for image in large]
            yield torch.stack([self._frame(image) for image in self._latest])
        if self._closed:
            return
        received = len(log) // 2
        wanted = reader.count or 0 if self._stop is None else self._stop
        if reader.live and reader.ended and (self._stop is None or received < self._stop):
            self.silent = f"{self.name} ended after {received} frames: {reader.ended}"
            warnings.warn(self.silent, stacklevel=2)
        elif not reader.live and (received < wanted or reader.damaged):
            words = f"{received - first} of {wanted - first} frames decoded"
            if reader.damaged:
                words = f"is damaged: {words}, {reader.damaged} or more are missing or wrong in part"
            elif log and reader.stamps and log[-2] >= reader.stamps[-1]:
                where = "at its start" if log[0] > reader.stamps[0] else "before its end"
                words = f"lacks frames {where}: {words}"
            else:
                words = f"ends early: {words}"
            warnings.warn(f"video {self.name} {words}", stacklevel=2)
            if received < wanted:
                self.length = (received - first) // every

    def _note_jump(self, number: int, seconds: float, time: float) -> None:
        gap = f"{seconds:g} s later" if seconds > 0 else f"{-seconds:g} s earlier"
        line = f"video {self.name}: frame {number + 1} is {gap} than the one before: treated as a cut"
        warnings.warn(line, stacklevel=3)
        self.cuts = (*self.cuts, time)

    def _frame(self, image: Image) -> Tensor:
        if image.ndim == 2 and not self._grey_noted:
            warnings.warn(f"video {self.name} is grey: copied into red, green and blue", stacklevel=4)
            self._grey_noted = True
        if self._fit == "reduce":
            return torch.from_numpy(_rgb(reduced(image, self.size))).permute(2, 0, 1)
        picture = torch.from_numpy(_rgb(image)).permute(2, 0, 1)[None]
        wide = torch.nn.functional.interpolate(picture, self._wide, mode="bilinear", antialias=True)[0]
        (top, left), (height, width) = self._corner, self.size
        return wide[:, top : top + height, left : left + width].contiguous()


def paced(
    frames: Iterable[StampedFrame],
    fps: float,
    log: array[float],
    timed: bool = True,
    start: int = 0,
    on_jump: Callable[[int, float, float], None] | None = None,
) -> Iterator[Image]:
    """The frame that is to be seen at every tick of a clock, by the frames' own time stamps.

    With a constant rate that is every frame once: stamps may be off by up to half of a tick. Where frames come too
    seldom the latest is repeated, where too many, some are left out. A gap in the stamps is a cut: the clock goes on.

    Args:
        frames: from the first of the source on.
        fps: ticks a second.
        log: stamp and tick of every frame are added to it.
        timed: whether stamps count; else every frame is a tick.
        start: number of the frame at tick 0.
        on_jump: called with the number of the frame after a gap, its seconds, and the time on the clock.
    """
    shown: StampedFrame | None = None
    time = before = offset = 0.0
    ticks, noted = 0, True
    for number, frame in enumerate(frames):
        if number < start:
            log.extend((frame.stamp, math.nan))
            continue
        if not timed:
            log.extend((frame.stamp, ticks))
            ticks += 1
            yield frame.image
            continue
        if shown is None:
            offset = frame.stamp
        else:
            step = frame.stamp - shown.stamp
            if step > max(JUMP_S, JUMP_INTERVALS / fps) or step < -max(BACK_S, 3 / fps):
                offset = frame.stamp - time - 1 / fps
                if on_jump is not None:
                    on_jump(number, step, time + 1 / fps)
            # A stamp that does not go on says nothing.
            now = frame.stamp - offset
            time = now if now > time else time + 1 / fps
            while (ticks + 0.5) / fps <= time:
                if not noted:
                    log.extend((shown.stamp, ticks))
                    noted = True
                yield shown.image
                ticks += 1
            if not noted:
                log.extend((shown.stamp, min(max(before * fps, ticks - 1.0), float(ticks))))
        shown, noted, before = frame, False, time
    if shown is not None:
        log.extend((shown.stamp, ticks))
        yield shown.image


def _rgb(image: Image) -> Image:
    import cv2

    return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB))


def reduced(image: Image, size: tuple[int, int]) -> Image:
    """The image at another size: averaged over whole blocks first, then interpolated; a third of the time of areas."""
    import cv2

    factor = min(image.shape[0] // size[0], image.shape[1] // size[1])
    if factor > 1:
        half = (image.shape[1] // factor, image.shape[0] // factor)
        image = np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if image.shape[:2] != size:
        image = np.asarray(cv2.resize(image, size[::-1], interpolation=cv2.INTER_LINEAR), dtype=np.uint8)
    return image
