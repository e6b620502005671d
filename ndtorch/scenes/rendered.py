"""What simulated scenes share: frames computed from their number, so that any of them can be had alone."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator

import torch
from torch import Tensor

from ndtorch.arguments import MOST_PIXELS, as_device, is_finite, is_whole
from ndtorch.errors import InputError
from ndtorch.scenes.base import FrameSource
from ndtorch.utils.tensors import keep_freed_memory

MOST_FPS, MOST_SECONDS = 1e5, 1e8
"""Frames a second and seconds of the fastest and the longest scene."""


class RenderedScene(FrameSource):
    """A simulated scene: frame n depends on n alone and comes out the same in whatever chunk it is.

    Args:
        name: short name, fit for a folder name.
        seconds: duration; the length is `round(seconds * fps)` frames, at least one.
        fps: frames per second.
        size: height and width in pixels.
        device: where the frames are computed.

    Raises:
        InputError: a duration, rate or size that is not positive and finite.
    """

    length: int

    def __init__(
        self, name: str, seconds: float, fps: float, size: tuple[int, int], device: torch.device | str = "cpu"
    ) -> None:
        if not (is_finite(fps) and 0 < fps <= MOST_FPS):
            raise InputError(f"fps must be a positive number of frames per second, got {repr(fps)[:40]}")
        if not (is_finite(seconds) and 0 < seconds <= MOST_SECONDS):
            raise InputError(f"seconds must be a positive number, {MOST_SECONDS:g} at most, got {repr(seconds)[:40]}")
        self.name = name
        self.fps = float(fps)
        self.size = check_size(size)
        self.length = max(1, round(seconds * fps))
        self.device = as_device(device)
        keep_freed_memory()

    @abstractmethod
    def frames(self, start: int, stop: int) -> Tensor:
        """Frames number `start` to `stop - 1`, `[..., T, 3, H, W]` float32 in 0..1, in new memory."""

    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[Tensor]:
        """Yield `[..., T, 3, H, W]` float32 in 0..1 with T <= `frames`, from frame `start` to the end.

        Raises:
            InputError: `frames` below 1 or `start` below 0.
        """
        check_chunks(frames, start)
        return (self.frames(n, min(n + frames, self.length)) for n in range(start, self.length, frames))


def check_chunks(frames: int, start: int) -> None:
    """Raise `InputError` unless `frames >= 1` and `start >= 0`."""
    if not (is_whole(frames) and frames >= 1):
        raise InputError(f"frames must be a whole number of at least 1 in a chunk, got {repr(frames)[:40]}")
    if not (is_whole(start) and start >= 0):
        raise InputError(f"start must be a frame number >= 0, got {repr(start)[:40]}")


def check_size(size: tuple[int, int]) -> tuple[int, int]:
    """Height and width as positive integers, or `InputError`."""
    sides = size if isinstance(size, tuple | list) else ()
    if len(sides) != 2 or not all(is_finite(side) and side == int(side) and side >= 1 for side in sides):
        raise InputError(f"size must be (height, width) in whole pixels >= 1, got {repr(size)[:40]}")
    if math.prod(size) > MOST_PIXELS:
        raise InputError(f"size must be {MOST_PIXELS} pixels in all at most, got {repr(size)[:40]}")
    return int(size[0]), int(size[1])
