"""Clips as files, and captures that are none."""

from __future__ import annotations

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
