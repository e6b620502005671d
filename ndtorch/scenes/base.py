"""What every source of frames offers: a rate, a size and chunks of frames in order."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator

from torch import Tensor


class FrameSource(ABC):
    """Frames in order: a simulated scene, a video, a folder of images or a camera.

    Attributes:
        name: short name, fit for a folder name.
        fps: frames per second.
        size: height and width of a frame in pixels.
        length: number of frames, or None where nobody can know (a camera).
    """

    name: str
    fps: float
    size: tuple[int, int]
    length: int | None

    @abstractmethod
    def chunks(self, frames: int = 8, start: int = 0) -> Iterator[Tensor]:
        """Yield `[..., T, 3, H, W]` with T <= `frames`, from frame number `start` on, until the source ends.

        Values are in 0..1 (float) or 0..255 (uint8). Every yielded tensor is the caller's to keep.
        A few frames at a time are fastest on a CPU: 500x500 RGB frames leave the cache after one or two.
        """
