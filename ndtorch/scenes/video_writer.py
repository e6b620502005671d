"""Writing frames into a video file."""

from __future__ import annotations

import math
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.scenes.readers import quiet_opencv
from ndtorch.scenes.rendered import check_size

CODECS = {".mp4": "mp4v", ".mkv": "FFV1", ".avi": "MJPG"}
"""Codec for each suffix: small, lossless, and editable frame by frame."""


class VideoWriter:
    """Writes frames one by one; usable in a `with` statement.

    Args:
        path: file to write, ending in .mp4 (mp4v), .mkv (FFV1, lossless) or .avi (MJPG).
        fps: frames a second.
        size: height and width of the frames; the codecs want both even.

    Raises:
        InputError: another suffix, a folder that does not exist, a rate or size out of range, or a file that
            cannot be written.
    """

    def __init__(self, path: str | Path, fps: float, size: tuple[int, int]) -> None:
        import cv2

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
        with quiet_opencv():
            fourcc = cv2.VideoWriter.fourcc(*codec)
            self._writer = cv2.VideoWriter(str(self.path), fourcc, fps, (self.size[1], self.size[0]))
        if not self._writer.isOpened():
            raise InputError(f"video {self.path} cannot be written: no permission, or no {codec} encoder")
        self._open, self._written = True, 0

    def write(self, frame: Tensor) -> None:
        """Append a frame `[3, H, W]`, red, green and blue: float in 0..1 (clipped) or uint8.

        Raises:
            InputError: another shape or type, or the file is closed.
        """
        import cv2

        if not self._open:
            raise InputError(f"video {self.path} is closed")
        if tuple(frame.shape) != (3, *self.size):
            raise InputError(f"frame must be [3, {self.size[0]}, {self.size[1]}], got {list(frame.shape)}")
        if frame.is_floating_point():
            frame = (frame.detach() * 255).round().clamp(0, 255).to(torch.uint8)
        elif frame.dtype != torch.uint8:
            raise InputError(f"frame must be float or uint8, got {frame.dtype}")
        rgb = np.ascontiguousarray(frame.cpu().permute(1, 2, 0).numpy())
        self._writer.write(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
        self._written += 1

    def close(self) -> None:
        """Finish the file. Closing twice does nothing.

        Raises:
            InputError: what was written cannot be read again, as on a full disk, of which the encoders say nothing.
        """
        was, self._open = self._open, False
        self._writer.release()
        if was and self._written and not self.is_whole():
            raise InputError(f"video {self.path} is not whole: the disk may be full")

    def is_whole(self) -> bool:
        """Whether the file that was closed opens, and promises all frames."""
        import cv2

        with quiet_opencv():
            capture = cv2.VideoCapture(str(self.path))
            # Some containers count a frame less or more than were given.
            promised = capture.get(cv2.CAP_PROP_FRAME_COUNT) if capture.isOpened() else 0
            whole = promised >= self._written - 1 and bool(capture.grab())
            capture.release()
        return whole

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
