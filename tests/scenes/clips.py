"""Clips as files, and captures that are none."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from ndtorch.scenes import VideoWriter

SIZE = (48, 64)


def pattern(number: int) -> Tensor:
    """A frame whose corners differ in color and whose brightness tells its number."""
    frame = torch.zeros(3, *SIZE, dtype=torch.uint8)
    frame[0, :24, :32] = 200
    frame[1, :24, 32:] = 200
    frame[2, 24:, :32] = 200
    frame[:, 24:, 32:] = 10 * number
    return frame


def write(path: Path, frames: int = 20, fps: float = 25.0) -> Path:
    with VideoWriter(path, fps, SIZE) as video:
        for n in range(frames):
            video.write(pattern(n))
    return path


def fake_capture(monkeypatch: pytest.MonkeyPatch, fps: float, count: float = 20, frames: int = 20) -> None:
    """Let `cv2.VideoCapture` be a device with this rate and number of frames."""

    class Capture:
        left = frames

        def __init__(self, source: object) -> None: ...
        def isOpened(self) -> bool:
            return True

        def get(self, what: int) -> float:
            return {cv2.CAP_PROP_FPS: fps, cv2.CAP_PROP_FRAME_COUNT: count}.get(what, 0)

        def grab(self) -> bool:
            self.left -= 1
            return self.left >= 0

        def read(self) -> tuple[bool, np.ndarray | None]:
            return (True, np.full((48, 64, 3), self.left, np.uint8)) if self.grab() else (False, None)

        def release(self) -> None:
            self.left = 0

    monkeypatch.setattr(cv2, "VideoCapture", Capture)


def film(
    path: Path, pictures: list[np.ndarray], stamps: list[float], claim: int = 25, container: str | None = None
) -> Path:
    """A video of pictures `[H, W, 3]` with these time stamps, whose stream claims a rate."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w", format=container) as file:
        stream = file.add_stream("libx264", rate=claim, options={"bf": "0", "crf": "20", "g": "20"})
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = Fraction(1, 1000)
        for picture, stamp in zip(pictures, stamps, strict=True):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
            frame.pts, frame.time_base = round(1000 * stamp), Fraction(1, 1000)
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    return path
