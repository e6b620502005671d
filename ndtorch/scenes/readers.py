"""What readers of videos, folders and cameras offer, and what files are checked for before they are opened."""

from __future__ import annotations

import os
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

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
    """Height and width of an image as its header has them; nothing is decoded."""
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
    """One of `LIMITS`, as the environment has it now. Raises `InputError`: it is no number, or out of range."""
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


Image = np.ndarray[Any, np.dtype[Any]]
"""`[H, W, 3]` in blue, green, red, or `[H, W]` in grey; uint8, or what the file has where it has more."""


class Frame(NamedTuple):
    """A decoded frame and its time stamp in seconds, on the clock of the source."""

    image: Image
    stamp: float


class Reader(ABC):
    """Where frames come from.

    Attributes:
        fps: rate of the frames as their time stamps show it, else as the source declares it; may be nonsense.
        count: number of frames, or None where it is not known before the last one.
        ticks: number of frames at a constant rate, by the time stamps; as `count`.
        live: whether frames pass only once.
        timed: whether time stamps say when a frame is to be seen; False takes frames as they follow.
        size: height and width of a frame as it comes.
        names: file names of the frames, of a folder.
        notes: what is to be said of the source, a line each.
    """

    fps: float
    count: int | None
    ticks: int | None
    live: bool = False
    timed: bool = False
    size: tuple[int, int]
    names: Sequence[str] | None = None
    notes: Sequence[str] = ()

    @abstractmethod
    def read(self) -> Iterator[Frame]:
        """Frames from the first on, until no more can be decoded. A live source goes on where it is."""

    def samples(self) -> list[tuple[Image, Image]]:
        """Pairs of successive images from all over the source; none of a live one."""
        return []

    def is_short(self, decoded: int, last: float) -> bool:
        """Whether frames are missing at the end: so many were decoded, the last with that stamp."""
        return self.count is not None and decoded < self.count

    def close(self) -> None:  # noqa: B027  nothing to do for most
        """Let go of the device, if any is held."""


def open_address(address: str, follow_redirects: bool = False) -> Any:
    """An open `cv2.VideoCapture` of an address, or None."""
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


MARGIN = 0.25
"""The stretched range goes on for this share of the values that were seen, at both sides."""
NOISE_LEVELS = 3.0
"""Levels of 255 that the noise of a pixel is stretched to at most."""
COMBED = 1.6
"""Interlaced: neighbouring rows of what moves differ so much more than rows of one field."""
MOVING_LEVELS = 12.0
"""Difference of two frames, levels of 255, at which a pixel has changed."""
MIN_MOVING = 60
"""Pixels that have to change before fields are looked for."""


class Stretch(NamedTuple):
    """Values `low` to `high` of deep images are shown as 0 to 255."""

    low: float
    high: float

    def __call__(self, image: Image) -> Image:
        scaled = (np.nan_to_num(image.astype(np.float32), nan=self.low) - self.low) * (255 / (self.high - self.low))
        levels: Image = np.clip(scaled + 0.5, 0, 255).astype(np.uint8)
        return levels

    def __str__(self) -> str:
        return f"values {self.low:.6g} to {self.high:.6g} are shown as 0 to 255"


def find_stretch(images: Sequence[Image]) -> Stretch | None:
    """The range of values of deep images; None where all are of eight bits.

    It holds all but a thousandth of the values, and is so wide that noise stays small.
    """
    deep = [np.asarray(image, np.float64) for image in images if image.dtype != np.uint8]
    if not deep:
        return None
    finite = [image[np.isfinite(image)] for image in deep]
    finite = [values for values in finite if values.size]
    if not finite:
        return Stretch(0.0, 1.0)
    low = float(np.min([np.quantile(values, 0.001) for values in finite]))
    high = float(np.max([np.quantile(values, 0.999) for values in finite]))
    steps = [np.abs(np.diff(image[::2], axis=1)) for image in deep]
    noise = float(np.median([np.nanmedian(step) for step in steps])) / (0.6745 * 2**0.5)
    room = float(max((high - low) * (1 + 2 * MARGIN), 255 / NOISE_LEVELS * noise, 1e-6))
    middle = 0.5 * (low + high)
    return Stretch(middle - room / 2, middle + room / 2)


def is_interlaced(pairs: Sequence[tuple[Image, Image]]) -> bool:
    """Whether rows of what moves alternate between two times, as in pictures woven of two fields."""
    votes = list[bool]()
    for before, after in pairs:
        first, second = grey(before), grey(after)
        if len(second) < 8:
            continue
        moving = np.abs(second - first)[2:-2] > MOVING_LEVELS
        moving = moving | np.roll(moving, 1, axis=0) | np.roll(moving, -1, axis=0)
        if moving.sum() < MIN_MOVING:
            continue
        rows = second[2:-2]
        neighbours = np.abs(2 * rows - second[1:-3] - second[3:-1])[moving].sum()
        field = np.abs(2 * rows - second[:-4] - second[4:])[moving].sum()
        votes.append(bool(neighbours > COMBED * field))
    return len(votes) > 0 and 2 * sum(votes) > len(votes)


def grey(image: Image) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    """One channel, float32."""
    return np.asarray(image if image.ndim == 2 else image[..., 1], dtype=np.float32)
