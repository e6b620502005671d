"""Writing frames into a video file."""

from __future__ import annotations

import math
import os
import struct
from fractions import Fraction
from pathlib import Path
from typing import Any, Protocol, Self

import numpy as np
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.scenes.base import check_size
from ndtorch.scenes.readers import quiet_opencv
from ndtorch.utils.packages import need

CODECS = {".mp4": "H.264", ".mkv": "FFV1", ".avi": "MJPG"}
"""Codec for each suffix: small and played by every browser, lossless, and editable frame by frame."""

LARGE = 1280 * 720
"""Pixels of a frame above which H.264 is written quickly, not as small as can be."""
QUALITY = "20"
"""Of H.264: its constant rate factor, 0 (lossless) to 51."""


class Encoder(Protocol):
    """What puts frames `[H, W, 3]` uint8, red, green and blue, into a file."""

    def write(self, rgb: np.ndarray[Any, Any]) -> None: ...

    def close(self) -> None: ...


class H264:
    """An .mp4 by PyAV; the index stands at the beginning, so that a browser plays it at once."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int]) -> None:
        av = need("av", "an .mp4 video")
        try:
            path.open("wb").close()  # the library finds out only when it writes
            self._file: Any = av.open(str(path), "w", options={"movflags": "faststart"})
            rate = Fraction(fps).limit_denominator(1001)
            # One thread: the frames of a run come one at a time, and the other core may be busy.
            preset = "veryfast" if size[0] * size[1] > LARGE else "medium"
            options = {"crf": QUALITY, "threads": "1", "preset": preset}
            self._stream: Any = self._file.add_stream("libx264", rate=rate, options=options)
        except (OSError, ValueError) as error:
            raise InputError(f"video {path} cannot be written: {getattr(error, 'strerror', None) or error}") from None
        self._stream.height, self._stream.width = size
        self._stream.pix_fmt = "yuv420p"
        self._frame = av.VideoFrame.from_ndarray

    def write(self, rgb: np.ndarray[Any, Any]) -> None:
        self._file.mux(self._stream.encode(self._frame(rgb, format="rgb24")))

    def close(self) -> None:
        if self._file is not None:
            self._file.mux(self._stream.encode(None))
            self._file.close()
            self._file = None


class OpenCV:
    """An .mkv or .avi by OpenCV."""

    def __init__(self, path: Path, fps: float, size: tuple[int, int], codec: str) -> None:
        import cv2

        with quiet_opencv():
            fourcc = cv2.VideoWriter.fourcc(*codec)
            self._writer = cv2.VideoWriter(str(path), fourcc, fps, (size[1], size[0]))
        if not self._writer.isOpened():
            raise InputError(f"video {path} cannot be written: no permission, or no {codec} encoder")
        self._swap = cv2.COLOR_RGB2BGR

    def write(self, rgb: np.ndarray[Any, Any]) -> None:
        import cv2

        self._writer.write(cv2.cvtColor(rgb, self._swap))

    def close(self) -> None:
        self._writer.release()


class VideoWriter:
    """Writes frames one by one; usable in a `with` statement.

    Args:
        path: file to write, ending in .mp4 (H.264), .mkv (FFV1, lossless) or .avi (MJPG).
        fps: frames a second.
        size: height and width of the frames; the codecs want both even.

    Raises:
        InputError: another suffix, a folder that does not exist, a rate or size out of range, or a file that
            cannot be written.
    """

    def __init__(self, path: str | Path, fps: float, size: tuple[int, int]) -> None:
        self.path = Path(path)
        self.size = check_size(size)
        codec = CODECS.get(self.path.suffix.lower())
        if codec is None:
            raise InputError(f"path must end in {', '.join(CODECS)}, got {self.path}")
        if not (fps > 0 and math.isfinite(fps)):
            raise InputError(f"fps must be a positive number of frames per second, got {fps}")
        if self.size[0] % 2 or self.size[1] % 2:
            raise InputError(f"size must be even in height and width to be written as video, got {self.size}")
        if not self.path.parent.is_dir():
            raise InputError(f"folder {self.path.parent} does not exist, {self.path.name} cannot be written there")
        self._writer: Encoder
        if codec == "H.264":
            self._writer = H264(self.path, fps, self.size)
        else:
            self._writer = OpenCV(self.path, fps, self.size, codec)
        self._open, self._written = True, 0

    def write(self, frame: Tensor) -> None:
        """Append a frame `[3, H, W]`, red, green and blue: float in 0..1 (clipped) or uint8.

        Raises:
            InputError: another shape or type, or the file is closed.
        """
        if not self._open:
            raise InputError(f"video {self.path} is closed")
        if tuple(frame.shape) != (3, *self.size):
            raise InputError(f"frame must be [3, {self.size[0]}, {self.size[1]}], got {list(frame.shape)}")
        if frame.is_floating_point():
            frame = (frame.detach() * 255).round().clamp(0, 255).to(torch.uint8)
        elif frame.dtype != torch.uint8:
            raise InputError(f"frame must be float or uint8, got {frame.dtype}")
        rgb = np.ascontiguousarray(frame.cpu().permute(1, 2, 0).numpy())
        self._writer.write(rgb)
        self._written += 1

    def close(self) -> None:
        """Finish the file; without any frame there is none. Closing twice does nothing.

        Raises:
            InputError: what was written cannot be read again, as on a full disk, of which the encoders say nothing.
        """
        was, self._open = self._open, False
        self._writer.close()
        if was and not self._written:
            self.path.unlink(missing_ok=True)
        elif was and not self.is_whole():
            raise InputError(f"video {self.path} is not whole: the disk may be full")

    def is_whole(self) -> bool:
        """Whether the file that was closed opens, promises all frames, and has the last of them."""
        import cv2

        if self.path.suffix.lower() == ".avi" and not as_long_as_it_says(self.path):
            return False
        with quiet_opencv():
            capture = cv2.VideoCapture(str(self.path))
            # Some containers count a frame less or more than were given.
            last = self._written - 2
            promised = capture.get(cv2.CAP_PROP_FRAME_COUNT) if capture.isOpened() else 0
            whole = promised > last and bool(capture.grab())
            if whole and last > 0:
                # A header may be written again after the disk was full, and promise what is not there.
                capture.set(cv2.CAP_PROP_POS_FRAMES, last)
                whole = capture.get(cv2.CAP_PROP_POS_FRAMES) >= last and bool(capture.grab())
            capture.release()
        return whole

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def as_long_as_it_says(path: Path) -> bool:
    """Whether an .avi has as many bytes as its first chunk claims."""
    with path.open("rb") as file:
        name, length = struct.unpack("<4sI", file.read(8).ljust(8, b"\0"))
        return bool(name == b"RIFF" and file.seek(0, os.SEEK_END) >= 8 + length)
