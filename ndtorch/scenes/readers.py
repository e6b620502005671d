"""Readers of image folders, videos and cameras, and what their files are checked for before they are opened."""

from __future__ import annotations

import math
import os
import re
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ndtorch.errors import InputError
from ndtorch.scenes.addresses import check_scheme, limited_ffmpeg, redirected


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Keep OpenCV's own messages off stderr: what went wrong is said once, in an `InputError`.

    OpenCV's log level is put back afterwards. FFmpeg inside OpenCV takes its level from the environment once,
    as the first video is opened; it stays quiet for the process unless `OPENCV_FFMPEG_LOGLEVEL` was set.
    """
    import cv2

    variable = "OPENCV_FFMPEG_LOGLEVEL"
    level = cv2.utils.logging.getLogLevel()
    ours = variable not in os.environ
    if ours:
        os.environ[variable] = "-8"
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
        if ours:
            os.environ.pop(variable, None)


MOST_PIXELS = 2**26
"""Pixels of the largest picture that is decoded, 8192 x 8192: a file of some bytes may claim any size."""

LONGEST = 2**15
"""Pixels of the longest side of a picture."""

LIMITS = {"NDTORCH_MOST_PIXELS": (MOST_PIXELS, 2**27), "NDTORCH_LONGEST_SIDE": (LONGEST, 2**20)}
"""Variables of the environment that set other limits: their values where they are not set, and the most they may be."""

LISTS = (b"ffconcat", b"#EXTM3U", b"<?xml", b"<MPD", b"[playlist]", b"[reference]", b"v=0")
"""How files begin that make FFmpeg open others: a video is one file, and opens none."""


def is_text(path: Path) -> bool:
    """Whether a file is text, or begins as those do that name other files to be opened."""
    with path.open("rb") as file:
        head = file.read(4096)
    if head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(LISTS):
        return True
    return (
        not head.startswith(b"YUV4MPEG2")
        and all(byte >= 32 or byte in b"\t\n\r\f\x1b" for byte in head[:512])
        and (_decodes(head))
    )


def _decodes(head: bytes) -> bool:
    """Whether bytes are UTF-8, but for a letter that is cut at the end."""
    try:
        head.decode()
    except UnicodeDecodeError as error:
        return error.start >= len(head) - 3
    return True


def claimed_size(path: Path) -> tuple[int, int]:
    """Height and width of an image as its header has them; nothing is decoded.

    Raises:
        InputError: no image, or one so large that not even its header is believed.
    """
    from PIL import Image as Headers

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Headers.DecompressionBombWarning)  # `check_pixels` has the word on that
            with Headers.open(path) as image:
                return image.height, image.width
    except Headers.DecompressionBombError:
        raise InputError(
            f"image {path} cannot be used: it claims more than {limit('NDTORCH_MOST_PIXELS')} pixels"
        ) from None
    except Exception:
        raise InputError(f"image {path} cannot be read: empty, damaged or not an image") from None


def limit(name: str) -> int:
    """One of `LIMITS`, as the environment has it now.

    Raises:
        InputError: it is no number, or out of range.
    """
    usual, most = LIMITS[name]
    given = os.environ.get(name, "")
    if not given:
        return usual
    if not (given.isascii() and given.isdigit() and len(given) < 12 and 1 <= int(given) <= most):
        raise InputError(f"{name} must be a number of pixels from 1 to {most}, got {given!r}")
    return int(given)


def check_pixels(what: str, height: int, width: int) -> None:
    """Raise `InputError` for pictures of more pixels, or of a longer side, than the limits allow."""
    most, longest = limit("NDTORCH_MOST_PIXELS"), limit("NDTORCH_LONGEST_SIDE")
    if height * width > most or max(height, width) > longest:
        raise InputError(
            f"{what} cannot be used: {width} x {height} pixels, {most} in all and {longest} a side are the most "
            f"({' and '.join(LIMITS)} set other limits)"
        )


Image = np.ndarray[Any, np.dtype[np.uint8]]
"""`[H, W, 3]` in blue, green, red, or `[H, W]` in grey."""

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".pgm", ".ppm")
FOLDER_FPS = 30.0


class Reader(ABC):
    """Where frames come from.

    Attributes:
        fps: rate the source declares; may be nonsense.
        count: number of frames the source promises, or None.
        live: whether frames pass only once.
        size: height and width of a frame as it comes.
    """

    fps: float
    count: int | None
    live: bool = False
    size: tuple[int, int]

    @abstractmethod
    def read(self, start: int) -> Iterator[Image]:
        """Frames from number `start` on, until no more can be decoded. A live source goes on where it is."""

    def close(self) -> None:  # noqa: B027  nothing to do for most
        """Let go of the device, if any is held."""


class FileReader(Reader):
    """A video file. Every reading opens it anew, so several may go on side by side.

    Attributes:
        timed: whether frames come at the file's rate by their own time stamps, as players show them: where they come
            too seldom the latest is repeated, where too many, some are left out. False takes them as they follow.
    """

    timed = True

    def __init__(self, path: Path) -> None:
        import cv2

        if path.stat().st_size == 0:
            raise InputError(f"video {path} is empty (0 bytes)")
        if is_text(path):
            raise InputError(f"video {path} cannot be used: it is text, or a list of other files")
        self.path = path
        with quiet_opencv():
            capture = open_capture(str(path))
            if capture is None:
                raise InputError(f"video {path} cannot be opened: not a video, damaged or cut off at its start")
            self.fps, self.count = _declared(capture)
            self.size = _declared_size(capture)
            check_pixels(f"video {path}", *self.size)
            # FFmpeg plays any text file as the screen of a terminal.
            decodes = capture.get(cv2.CAP_PROP_FOURCC) != cv2.VideoWriter.fourcc(*"ansi") and capture.grab()
            capture.release()
        if not decodes:
            raise InputError(f"video {path} cannot be used: it is text, or none of its frames can be decoded")

    def read(self, start: int) -> Iterator[Image]:
        with quiet_opencv():
            capture = open_capture(str(self.path))
        if capture is None:
            raise InputError(f"video {self.path} can no longer be opened")
        try:
            # Seeking by frame number lands between frames in some containers; counting never does.
            if self.timed and 0 < self.fps < math.inf:
                yield from islice(_by_time(capture, self.fps), start, None)
                return
            for _ in range(start):
                if not capture.grab():
                    return
            yield from _frames(capture)
        finally:
            capture.release()


class LiveReader(Reader):
    """A camera or a stream: held open, every frame passes once."""

    live = True

    def __init__(self, source: int | str, follow_redirects: bool = False) -> None:
        what = f"camera {source}" if isinstance(source, int) else str(source)
        with quiet_opencv():
            if isinstance(source, str) and "://" in source:
                capture = open_address(source, follow_redirects)
            else:
                capture = open_capture(source)
            if capture is None:
                raise InputError(f"{what} cannot be opened: not there, in use, no permission, or a list of others")
            first = next(_frames(capture), None)
        if first is None:
            capture.release()
            raise InputError(f"{what} opens but delivers no frames")
        self.fps, self.count = _declared(capture)[0], None
        self.size = (first.shape[0], first.shape[1])
        self._capture, self._first = capture, [first]

    def read(self, start: int) -> Iterator[Image]:
        while self._first:
            yield self._first.pop()
        yield from _frames(self._capture)

    def close(self) -> None:
        self._first.clear()
        self._capture.release()


class FolderReader(Reader):
    """The images of a folder in natural order: 2.png comes before 10.png."""

    def __init__(self, folder: Path) -> None:
        import cv2

        files = (path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES)
        self.files = sorted(files, key=_natural)
        if not self.files:
            raise InputError(f"folder {folder} holds no images ({', '.join(IMAGE_SUFFIXES)})")
        self.fps, self.count = FOLDER_FPS, len(self.files)
        with quiet_opencv():
            for path in self.files:
                if not path.is_file():
                    raise InputError(f"image {path} cannot be read: it is no regular file")
                if not cv2.haveImageReader(str(path)):
                    raise InputError(f"image {path} cannot be read: empty, damaged or not an image")
            first = _image(self.files[0])
        self.size = (first.shape[0], first.shape[1])

    def read(self, start: int) -> Iterator[Image]:
        for path in self.files[start:]:
            image = _image(path)
            if image.shape[:2] != self.size:
                (height, width), (own_height, own_width) = self.size, image.shape[:2]
                raise InputError(
                    f"images of a folder must have one size: {self.files[0]} is {width} x {height} pixels, "
                    f"{path} {own_width} x {own_height}"
                )
            yield image


def open_address(address: str, follow_redirects: bool = False) -> Any:
    """An open `cv2.VideoCapture` of an address, or None.

    Raises:
        InputError: a scheme that is not opened, or a redirect to another host that is not allowed.
    """
    check_scheme(address)
    capture = open_capture(address)
    if capture is None and (to := redirected(address, follow_redirects)) != address:
        capture = open_capture(to)
    return capture


def open_capture(source: int | str) -> Any:
    """An open `cv2.VideoCapture`, or None. What FFmpeg may open besides is in `ndtorch.scenes.addresses`."""
    import cv2

    address = isinstance(source, str) and "://" in source
    try:
        with limited_ffmpeg(address):
            capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG) if address else cv2.VideoCapture(source)
    except cv2.error:
        return None
    return capture if capture.isOpened() else None


def _declared(capture: Any) -> tuple[float, int | None]:
    """Rate and number of frames as the container declares them; None where it does not know the number."""
    import cv2

    count = capture.get(cv2.CAP_PROP_FRAME_COUNT)
    return float(capture.get(cv2.CAP_PROP_FPS)), int(count) if 0 < count < 2**53 else None


def _declared_size(capture: Any) -> tuple[int, int]:
    """Height and width of the frames of an open capture."""
    import cv2

    return int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)), int(capture.get(cv2.CAP_PROP_FRAME_WIDTH))


def _frames(capture: Any) -> Iterator[Image]:
    while True:
        decoded, frame = capture.read()
        if not decoded:
            return
        yield frame


def _by_time(capture: Any, fps: float) -> Iterator[Image]:
    """The frame that is to be seen at every tick of a clock, by the frames' own time stamps.

    With a constant rate that is every frame once: stamps may be off by up to half of a tick.
    """
    import cv2

    decoded, shown = capture.read()
    first = time = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
    ticks = 0
    while decoded:
        decoded, frame = capture.read()
        if decoded:
            stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            # A stamp that does not go on says nothing.
            time = stamp if stamp > time else time + 1 / fps
        while not decoded or (ticks + 0.5) / fps <= time - first:
            yield shown
            ticks += 1
            if not decoded:
                return
        shown = frame


def _image(path: Path) -> Image:
    """Eight bits a channel, turned upright as the file says, without transparency; grey stays `[H, W]`."""
    import cv2

    check_pixels(f"image {path}", *claimed_size(path))
    try:
        with quiet_opencv():
            image = cv2.imread(str(path), cv2.IMREAD_ANYCOLOR)
    except cv2.error:
        image = None
    if image is None:
        raise InputError(f"image {path} cannot be read: empty, damaged or not an image")
    return np.asarray(image, dtype=np.uint8)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key in which runs of digits count as numbers."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name.lower())]
