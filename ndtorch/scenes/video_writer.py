"""Writing frames into a video file."""

from __future__ import annotations

import math
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import check_size
from ndtorch.errors import InputError
from ndtorch.utils.packages import need

CODECS = {".mp4": ("libx264", "yuv420p"), ".mkv": ("ffv1", "bgr0"), ".avi": ("mjpeg", "yuvj420p")}
"""Codec and pixels for each suffix: small and played by every browser, lossless, and editable frame by frame."""


class VideoWriter:
    """Writes frames one by one; usable in a `with` statement.

    Args:
        path: file to write, ending in .mp4 (H.264), .mkv (FFV1, lossless) or .avi (MJPG).
        fps: frames a second.
        size: height and width of the frames; the codecs want both even.

    Raises:
        InputError: another suffix, a rate or size out of range, or a file that cannot be written, also later on.
    """

    def __init__(self, path: str | Path, fps: float, size: tuple[int, int]) -> None:
        check_size("size", size, 1)
        self.path, self.size = Path(path), (int(size[0]), int(size[1]))
        if self.path.suffix.lower() not in CODECS:
            raise InputError(f"path must end in {', '.join(CODECS)}, got {self.path}")
        if not (fps > 0 and math.isfinite(fps)):
            raise InputError(f"fps must be a positive number of frames per second, got {fps}")
        if self.size[0] % 2 or self.size[1] % 2:
            raise InputError(f"size must be even in height and width to be written as video, got {self.size}")
        codec, kind = CODECS[self.path.suffix.lower()]
        options, movie = {}, {}
        if codec == "libx264":
            # The index stands at the beginning, so that a browser plays the film at once. One thread: the frames of a
            # run come one at a time, and the other core may be busy. Slower presets keep 40 frames back, which are
            # encoded when the film is closed.
            movie = {"movflags": "faststart"}
            options = {"crf": "20", "threads": "1", "preset": "veryfast"}
        elif codec == "mjpeg":
            options = {"qmin": "2", "qmax": "3"}
        self._av = need("av", "a video file")
        try:
            self.path.open("wb").close()  # the library finds out only when it writes
            self._file: Any = self._av.open(str(self.path), "w", options=movie)
            rate = Fraction(fps).limit_denominator(1001)
            self._stream: Any = self._file.add_stream(codec, rate=rate, options=options)
        except (OSError, ValueError) as error:
            raise self._unwritten(error) from None
        self._stream.height, self._stream.width = self.size
        self._stream.pix_fmt = kind
        self._open, self._written = True, 0

    def write(self, frame: Tensor) -> None:
        """Append a frame `[3, H, W]`, red, green and blue: float in 0..1 (clipped) or uint8.

        Raises:
            InputError: another shape or type, or the file is closed or cannot be written.
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
        try:
            self._file.mux(self._stream.encode(self._av.VideoFrame.from_ndarray(rgb, format="rgb24")))
        except (self._av.FFmpegError, OSError) as error:
            raise self._unwritten(error) from None
        self._written += 1

    def close(self) -> None:
        """Finish the file; without any frame there is none. Closing twice does nothing.

        Raises:
            InputError: the file cannot be written, as on a full disk.
        """
        was, self._open = self._open, False
        if not was:
            return
        try:
            if self._written:
                self._file.mux(self._stream.encode(None))
            self._file.close()
        except (self._av.FFmpegError, OSError) as error:
            raise self._unwritten(error) from None
        if not self._written:
            self.path.unlink(missing_ok=True)

    def _unwritten(self, error: Exception) -> InputError:
        self._open = False  # closing a file that could not be written ends the process
        return InputError(f"video {self.path} cannot be written: {getattr(error, 'strerror', None) or error}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
