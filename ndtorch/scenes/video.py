"""Video, image folders and cameras as a source of frames."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Literal, Self

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import is_finite, is_whole
from ndtorch.errors import InputError
from ndtorch.scenes.base import FrameSource, PixelMap, check_chunks, check_size
from ndtorch.scenes.image_folder import IMAGE_SUFFIXES, FolderReader, PagesReader
from ndtorch.scenes.live import CameraReader, LiveReader, StreamReader
from ndtorch.scenes.readers import Image, Reader, Stretch, find_stretch, is_interlaced, is_text
from ndtorch.scenes.stamps import FrameLog, SourceFrames, paced
from ndtorch.scenes.video_file import FileReader

log = logging.getLogger(__name__)
_declared: list[torch.library.Library] = []


def import_torchvision() -> None:
    """Import torchvision, also beside a PyTorch its compiled operators do not fit (a CPU-only one).

    torchvision describes its operators `nms` and `qnms` to PyTorch as it is imported, and fails where the
    compiled library that should have declared them did not load. Resizing and cropping need neither, so they
    are declared here without an implementation, and only once the import has failed for that reason.
    """
    try:
        import torchvision
    except RuntimeError as error:
        if "operator torchvision::" not in str(error) or _declared:
            raise
        # The declarations last as long as this object does.
        library = torch.library.Library("torchvision", "DEF")  # type: ignore[no-untyped-call]
        for name in ("nms", "qnms"):
            schema = f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor"
            library.define(schema)  # type: ignore[no-untyped-call]
        _declared.append(library)
        import torchvision  # noqa: F401


Fit = Literal["crop", "stretch", "reduce"]
FASTEST = 1000.0
"""Frames a second above which a declared rate is taken for nonsense."""


def open_video(
    source: int | str | Path,
    size: tuple[int, int] = (500, 500),
    fps: float | None = None,
    start: int | None = None,
    stop: int | None = None,
    fit: Fit = "crop",
    follow_redirects: bool = False,
    every: int = 1,
) -> VideoSource:
    """Open a video file, a folder of images, a camera or a stream, and decode its first frame.

    Args:
        source: a file; a folder, whose images are taken in natural order; a camera as a number, as "camera:0"
            or as /dev/video0; or an address with "://".
        size: height and width of the frames delivered; with "reduce" only the height counts.
        fps: frames a second where the source has no time stamps or wrong ones. A folder has 30 otherwise. Without it,
            the frames of a file come by their own time stamps, so that those of a variable rate come at a constant one.
        start, stop: the first frame of the source and the one after the last; None for all of it.
        every: of so many frames the first is delivered, at a rate so much lower.
        fit: "crop" scales until the image covers `size` and cuts off what sticks out; "stretch" scales both
            sides separately; "reduce" keeps the whole image and its aspect (within the rounding of the width to a
            multiple of 8), is quicker, and never enlarges: fewer rows than `size` asks for come as they are.
        follow_redirects: of an address, also to other hosts. An address is one film or stream: playlists are refused.

    Returns:
        A source of frames `[T, 3, H, W]` uint8, red, green and blue.

    Raises:
        InputError: a source that is missing, empty, unreadable or not a video, a rate that is not in
            0..1000 Hz while `fps` is not given, or `size`, `fps`, `start`, `stop`, `fit` or `every` out of range.
    """
    size = check_size(size)
    if fit not in ("crop", "stretch", "reduce"):
        raise InputError(f"fit must be 'crop', 'stretch' or 'reduce', got {fit!r}")
    if fps is not None and not (is_finite(fps) and fps > 0):
        raise InputError(f"fps must be a positive number of frames per second, got {repr(fps)[:40]}")
    if not all(part is None or is_whole(part) for part in (start, stop)):
        raise InputError(f"start and stop must be frame numbers, got {repr(start)[:40]} and {repr(stop)[:40]}")
    first = 0 if start is None else start
    if first < 0 or (stop is not None and stop <= first):
        raise InputError(f"start and stop must be frame numbers with 0 <= start < stop, got {start} and {stop}")

    if not (is_whole(every) and every >= 1):
        raise InputError(f"every must be a number of frames from 1, got {every}")

    reader, name = _reader(source, follow_redirects)
    try:
        if fps is not None:
            reader.timed = False
            if reader.names is not None or isinstance(reader, PagesReader):
                reader.fps, reader.notes = fps, [line for line in reader.notes if "assumed" not in line]
        elif not 0 < reader.fps <= FASTEST:
            raise InputError(f"fps must be given for {source}, which declares {reader.fps:g} frames per second")
        if reader.count is not None and max(first + 1, stop or 0) > reader.count:
            raise InputError(f"start and stop must lie within the {reader.count} frames, got {start} and {stop}")
        if first and not reader.live and next(islice(reader.read(), first, None), None) is None:
            raise InputError(f"start must be a frame that can be decoded, got {start}: {source} ends before it")
        stretch, field = _kind(reader, name)
    except InputError:
        reader.close()
        raise
    for line in reader.notes:
        log.info(line)
    if fit == "reduce":
        height, width = reader.size
        rows = min(size[0], height)
        size = (rows, max(8, round(rows * width / height / 8) * 8))
    return VideoSource(reader, name, fps or reader.fps, size, first, stop, fit, every, stretch, field)


def _kind(reader: Reader, name: str) -> tuple[Stretch | None, bool]:
    """How deep images are shown as eight bits, and whether one field is taken of every image; both are said."""
    pairs = reader.samples()
    stretch = find_stretch([image for pair in pairs for image in pair])
    if stretch is not None:
        pairs = [(stretch(before), stretch(after)) for before, after in pairs]
        warnings.warn(f"video {name} has more than eight bits: {stretch}", stacklevel=3)
    field = is_interlaced(pairs)
    if field:
        warnings.warn(f"video {name} is interlaced: one field of every frame is used, the other left out", stacklevel=3)
    return stretch, field


class VideoSource(FrameSource):
    """Frames of real video; made by `open_video`. Usable in a `with` statement.

    Attributes:
        truncated: whether a reading ended before the number of frames the source had promised; then `length`
            becomes what could be decoded, and a warning says so once.
    """

    def __init__(
        self,
        reader: Reader,
        name: str,
        fps: float,
        size: tuple[int, int],
        start: int,
        stop: int | None,
        fit: Fit,
        every: int = 1,
        stretch: Stretch | None = None,
        field: bool = False,
    ) -> None:
        self.name, self.fps, self.size = name, float(fps) / every, size
        self.truncated, self.silent = False, ""
        self.pixel_map = _pixel_map(reader.size, size, fit)
        self._latest: Image | None = None
        self._reader, self._start, self._stop, self._every = reader, start, stop, every
        self._rate, self._stretch, self._field = float(fps), stretch, field
        self._reduce = fit == "reduce"
        self._resize = (lambda image: image) if self._reduce else _resizer(size, fit)
        self._grey_told = self._closed = False
        self._skip = start if reader.live else 0
        self._log = FrameLog(reader.names)
        self.length = self._length()

    def _length(self) -> int | None:
        """Number of frames that are delivered, as far as it is known."""
        whole = self._start == 0 and self._stop is None
        count = self._reader.ticks if whole and self._reader.timed else self._reader.count
        end = count if self._stop is None else self._stop
        if end is None or (self._reader.count is None and not self._reader.live and self._stop is not None):
            return None
        return -(-(end - self._start) // self._every)

    @property
    def full_size(self) -> tuple[int, int]:
        return self._reader.size

    @property
    def decoded(self) -> SourceFrames:
        found = self._log.frames()
        return found._replace(tick=found.tick / self._every)

    def latest(self) -> Image | None:
        import cv2

        if self._latest is None:
            return None
        image = self._latest
        if image.shape[:2] != self.full_size:
            image = np.asarray(cv2.resize(image, self.full_size[::-1], interpolation=cv2.INTER_LINEAR))
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB))

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
        """Let go of the camera or file; reading afterwards is an error."""
        self._closed = True
        self._reader.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _chunks(self, frames: int, start: int) -> Iterator[Tensor]:
        log = self._log = FrameLog(self._reader.names)
        self.cuts = ()
        every, reader = self._every, self._reader
        decoded = islice(reader.read(), self._stop) if self._stop is not None else reader.read()
        first = self._skip if reader.live else self._start
        self._skip = 0
        images = paced(decoded, self._rate, log, reader.timed, first, self._note_jump)
        images = islice(images, start * every, None, every)
        while batch := [self._frame(image) for image in islice(images, frames)]:
            yield torch.stack(batch)
        if self._closed:
            return
        if isinstance(reader, LiveReader):
            self._note_silence(len(log), reader.ended)
        elif self._stop is None or len(log) < self._stop:
            short = self._stop is not None and reader.count is not None
            if short or reader.is_short(len(log), log.last):
                self._note_end(len(log) - first)

    def _note_jump(self, number: int, seconds: float, time: float) -> None:
        gap = f"{seconds:g} s later" if seconds > 0 else f"{-seconds:g} s earlier"
        line = f"video {self.name}: frame {number + 1} is {gap} than the one before: taken as a cut"
        warnings.warn(line, stacklevel=3)
        self.cuts = (*self.cuts, time)

    def _note_silence(self, received: int, why: str) -> None:
        if why and (self._stop is None or received < self._stop):
            self.silent = f"{self.name} ended after {received} frames: {why}"
            warnings.warn(self.silent, stacklevel=3)

    def _note_end(self, decoded: int) -> None:
        if not self.truncated:
            whole = getattr(self._reader, "promised", 0)
            promised = f" of {whole - self._start}" if whole and self._stop is None else ""
            warnings.warn(f"video {self.name} ends early: {decoded}{promised} frames decoded", stacklevel=3)
        self.truncated, self.length = True, decoded // self._every

    def _frame(self, image: Image) -> Tensor:
        import cv2

        if self._stretch is not None:
            image = self._stretch(image)
        if self._field:
            image = np.ascontiguousarray(image[::2])
            if not self._reduce:
                image = np.asarray(cv2.resize(image, self.full_size[::-1], interpolation=cv2.INTER_LINEAR))
        if image.ndim == 2 and not self._grey_told:
            warnings.warn(f"video {self.name} is grey: copied into red, green and blue", stacklevel=4)
            self._grey_told = True
        self._latest = image
        if self._reduce:
            image = reduced(image, self.size)
        rgb = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB)
        return self._resize(torch.from_numpy(rgb).permute(2, 0, 1))


def _pixel_map(full: tuple[int, int], size: tuple[int, int], fit: Fit) -> PixelMap:
    """From the frames that are delivered to those of the source."""
    if fit != "crop":
        return PixelMap(full[1] / size[1], full[0] / size[0])
    scale = max(size[0] / full[0], size[1] / full[1])
    wide = round(full[0] * scale), round(full[1] * scale)
    down, across = full[0] / wide[0], full[1] / wide[1]
    return PixelMap(across, down, round((wide[1] - size[1]) / 2) * across, round((wide[0] - size[0]) / 2) * down)


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


def _reader(source: int | str | Path, follow_redirects: bool) -> tuple[Reader, str]:
    """The reader for a source, and a name for it."""
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
        return CameraReader(source), f"camera-{source}"
    if isinstance(source, str) and "://" in source:
        return StreamReader(source, follow_redirects), source.rstrip("/").rsplit("/", 1)[-1]
    path = Path(source)
    if not path.exists():
        where = "is a link to a file that is not there" if path.is_symlink() else "does not exist"
        raise InputError(f"video {path} {where}")
    if path.is_dir():
        return FolderReader(path), path.resolve().name
    if path.is_char_device():
        return CameraReader(str(path)), path.name
    if path.suffix.lower() in IMAGE_SUFFIXES and not is_text(path):
        return PagesReader(path), path.stem
    return FileReader(path), path.stem


def _resizer(size: tuple[int, int], fit: Fit) -> Callable[[Tensor], Tensor]:
    """A function from `[3, h, w]` uint8 to `[3, *size]` uint8."""
    import_torchvision()
    from torchvision import tv_tensors
    from torchvision.transforms import v2

    def resize(image: Tensor) -> Tensor:
        height, width = image.shape[-2:]
        scale = max(size[0] / height, size[1] / width)
        target = list(size) if fit == "stretch" else [round(height * scale), round(width * scale)]
        video = v2.functional.resize(tv_tensors.Video(image[None]), target, antialias=True)
        out: Tensor = v2.functional.center_crop(video, list(size)).as_subclass(Tensor)
        return out[0].contiguous()

    return resize
