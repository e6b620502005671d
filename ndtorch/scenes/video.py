"""Video, image folders and cameras as a source of frames."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import is_finite, is_whole
from ndtorch.errors import InputError
from ndtorch.scenes.base import FrameSource
from ndtorch.scenes.readers import FileReader, FolderReader, Image, LiveReader, Reader
from ndtorch.scenes.rendered import check_chunks, check_size

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
) -> VideoSource:
    """Open a video file, a folder of images, a camera or a stream, and decode its first frame.

    Args:
        source: a file; a folder, whose images are taken in natural order; a camera as a number, as "camera:0"
            or as /dev/video0; or an address with "://".
        size: height and width of the frames delivered; with "reduce" only the height counts.
        fps: frames a second where the source declares none or a wrong one. A folder has 30 otherwise. Without it, the
            frames of a file come by their own time stamps, so that those of a variable rate come at a constant one.
        start, stop: the first frame of the source and the one after the last; None for all of it.
        fit: "crop" scales until the image covers `size` and cuts off what sticks out; "stretch" scales both
            sides separately; "reduce" keeps the whole image and its aspect (within the rounding of the width to a
            multiple of 8), is quicker, and never enlarges: fewer rows than `size` asks for come as they are.
        follow_redirects: of an address, also to other hosts. An address is one film or stream: playlists are refused.

    Returns:
        A source of frames `[T, 3, H, W]` uint8, red, green and blue.

    Raises:
        InputError: a source that is missing, empty, unreadable or not a video, a rate that is not in
            0..1000 Hz while `fps` is not given, or `size`, `fps`, `start`, `stop` or `fit` out of range.
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

    reader, name = _reader(source, follow_redirects)
    if isinstance(reader, FileReader):
        reader.timed = fps is None
    try:
        if fps is None and not 0 < reader.fps <= FASTEST:
            raise InputError(f"fps must be given for {source}, which declares {reader.fps} frames per second")
        if reader.count is not None and max(first + 1, stop or 0) > reader.count:
            raise InputError(f"start and stop must lie within the {reader.count} frames, got {start} and {stop}")
        if first and not reader.live and next(iter(reader.read(first)), None) is None:
            raise InputError(f"start must be a frame that can be decoded, got {start}: {source} ends before it")
    except InputError:
        reader.close()
        raise
    if fit == "reduce":
        height, width = reader.size
        rows = min(size[0], height)
        size = (rows, max(8, round(rows * width / height / 8) * 8))
    return VideoSource(reader, name, fps or reader.fps, size, first, stop, fit)


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
    ) -> None:
        self.name, self.fps, self.size = name, float(fps), size
        end = reader.count if stop is None else stop
        self.length = None if end is None or (reader.count is None and not reader.live) else end - start
        self.truncated = False
        self._reader, self._start = reader, start
        self._most = None if end is None else end - start
        self._reduce = fit == "reduce"
        self._resize = (lambda image: image) if self._reduce else _resizer(size, fit)
        self._grey_told = self._closed = False
        self._skip = start if reader.live else 0

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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _chunks(self, frames: int, start: int) -> Iterator[Tensor]:
        left = None if self._most is None else max(0, self._most - start)
        images = self._reader.read(self._start + start)
        if self._skip:
            images = islice(images, self._skip, None)
            self._skip = 0
        images = islice(images, left)
        done = 0
        while batch := [self._frame(image) for image in islice(images, frames)]:
            done += len(batch)
            yield torch.stack(batch)
        if left is not None and done < left and not self._closed:
            self._note_end(start + done)

    def _note_end(self, decoded: int) -> None:
        if not self.truncated:
            promised = "" if self.length is None else f" of {self.length}"
            warnings.warn(f"video {self.name} ends early: {decoded}{promised} frames decoded", stacklevel=3)
        self.truncated, self.length = True, decoded

    def _frame(self, image: Image) -> Tensor:
        import cv2

        if image.ndim == 2 and not self._grey_told:
            warnings.warn(f"video {self.name} is grey: copied into red, green and blue", stacklevel=4)
            self._grey_told = True
        if self._reduce:
            image = reduced(image, self.size)
        rgb = cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB)
        return self._resize(torch.from_numpy(rgb).permute(2, 0, 1))


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
        return LiveReader(source), f"camera-{source}"
    if isinstance(source, str) and "://" in source:
        return LiveReader(source, follow_redirects), source.rstrip("/").rsplit("/", 1)[-1]
    path = Path(source)
    if not path.exists():
        raise InputError(f"video {path} does not exist")
    if path.is_dir():
        return FolderReader(path), path.resolve().name
    if path.is_char_device():
        return LiveReader(str(path)), path.name
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
