"""What kind of pictures a source has: more than eight bits, whose range is stretched, and interlaced fields."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ndtorch.scenes.readers import Image

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
