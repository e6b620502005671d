"""What a method says of a clip, and what the truth says, frame by frame."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Pixels = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]


class Box(NamedTuple):
    """Left, top, right and bottom, pixels of the clip."""

    left: float
    top: float
    right: float
    bottom: float


class Sight(NamedTuple):
    """One object at one frame: its track's number, where it is said to be (column and row), and its box."""

    track: int
    place: tuple[float, float]
    box: Box


class Packed:
    """A mask that takes little room."""

    def __init__(self, mask: Mask) -> None:
        self.shape = mask.shape
        self.bits = zlib.compress(np.packbits(mask).tobytes(), 1)

    def mask(self) -> Mask:
        """The mask as it was."""
        bits = np.frombuffer(zlib.decompress(self.bits), np.uint8)
        return np.unpackbits(bits, count=self.shape[0] * self.shape[1]).reshape(self.shape).astype(bool)


@dataclass
class Seen:
    """What a method made of a clip.

    Attributes:
        sights: the objects of every frame.
        masks: what moves, of every frame; empty of methods without.
        seconds: processor time, without decoding.
    """

    sights: list[list[Sight]] = field(default_factory=list)
    masks: list[Packed] = field(default_factory=list)
    seconds: float = 0.0


class Clip(NamedTuple):
    """A clip: its name, its frames `[H, W, 3]` in blue, green, red (an iterable that can be read again), frames a
    second, and height and width."""

    name: str
    frames: Any
    fps: float
    size: tuple[int, int]
