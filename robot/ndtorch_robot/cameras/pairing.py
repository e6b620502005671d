"""Which frames of two cameras belong together."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ndtorch.errors import InputError
from ndtorch_robot.cameras.source import Image


class Frame(NamedTuple):
    """One image of one camera.

    Attributes:
        image: as OpenCV gives it.
        time: when it was taken, s on the monotonic clock.
        arrived: when it was here and decoded, s on the same clock.
    """

    image: Image
    time: float
    arrived: float


class Pair(NamedTuple):
    """Two frames of one moment."""

    left: Frame
    right: Frame

    @property
    def time(self) -> float:
        """When the older one was taken: what is said about age is then never too good."""
        return min(self.left.time, self.right.time)

    @property
    def skew(self) -> float:
        return self.right.time - self.left.time


@dataclass
class PairStatistics:
    """What became of the frames so far.

    Attributes:
        frames: of the left and the right camera.
        pairs: made of them.
        unpaired: frames of the left and the right camera that found no partner.
        unread: pairs that a newer one replaced before anybody asked.
        skews: of the last pairs, s.
    """

    frames: list[int] = field(default_factory=lambda: [0, 0])
    pairs: int = 0
    unpaired: list[int] = field(default_factory=lambda: [0, 0])
    unread: int = 0
    skews: Any = None

    def copy(self) -> PairStatistics:
        return PairStatistics(list(self.frames), self.pairs, list(self.unpaired), self.unread, list(self.skews or ()))

    def skew_ms(self) -> dict[str, float]:
        """Mean, and median, 99th percentile and maximum of its size, in ms; empty before the first pair."""
        if not self.skews:
            return {}
        skews = np.array(self.skews) * 1e3
        size = np.abs(skews)
        p50, p99 = np.percentile(size, (50, 99))
        return {"mean": float(skews.mean()), "p50": float(p50), "p99": float(p99), "max": float(size.max())}


class Pairing:
    """Pairs frames by their times, as they come.

    Only the newest frame of each camera is kept. A frame is paired with the newest one of the other camera,
    if that is still free and within the tolerance, so no frame is used twice.

    Args:
        tolerance: largest difference in time, s.
        kept: skews to keep.
    """

    def __init__(self, tolerance: float, kept: int = 3000) -> None:
        from collections import deque

        if kept < 0 or tolerance < 0:
            raise InputError(f"tolerance and kept must be >= 0, got {tolerance:g} and {kept}")
        self.tolerance = tolerance
        self.newest: list[Frame | None] = [None, None]
        self.free = [False, False]
        self.statistics = PairStatistics(skews=deque(maxlen=kept))

    def add(self, side: int, frame: Frame) -> Pair | None:
        """A new frame of camera `side` (0 left, 1 right); returns the pair it makes, if it does."""
        numbers = self.statistics
        numbers.frames[side] += 1
        if self.free[side]:
            numbers.unpaired[side] += 1
        self.newest[side], self.free[side] = frame, True
        other = self.newest[1 - side]
        if other is None or not self.free[1 - side] or abs(frame.time - other.time) > self.tolerance:
            return None
        self.free = [False, False]
        pair = Pair(frame, other) if side == 0 else Pair(other, frame)
        numbers.pairs += 1
        numbers.skews.append(pair.skew)
        return pair
