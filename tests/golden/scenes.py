"""Clips for the goldens, of whole numbers and NumPy alone: every machine draws the same bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

HEIGHT, WIDTH, SIDE = 112, 200, 24

Image = npt.NDArray[np.int32]

RED, GREEN, BLUE, YELLOW = (205, 50, 50), (50, 205, 50), (60, 70, 215), (210, 200, 50)


class Clip(NamedTuple):
    """A clip: frames a second, number of frames, and what draws frame `n` onto the ground."""

    fps: float
    frames: int
    draw: Callable[[Image, int], None]

    def chunks(self, length: int) -> Iterator[Tensor]:
        """The frames `[T, 3, H, W]` uint8, `length` at a time."""
        ground = textured_ground()
        for first in range(0, self.frames, length):
            numbers = range(first, min(first + length, self.frames))
            yield torch.from_numpy(np.stack([self.frame(ground, n) for n in numbers]))

    def frame(self, ground: Image, n: int) -> npt.NDArray[np.uint8]:
        """Frame `n`, `[3, H, W]`, with two levels of noise."""
        image = ground.copy()
        self.draw(image, n)
        image += np.random.default_rng((7, n)).integers(-2, 3, image.shape, dtype=np.int32)
        return np.clip(image, 0, 255).astype(np.uint8)


def textured_ground() -> Image:
    """A grey ground `[3, H, W]` of smooth blotches."""
    coarse = np.random.default_rng(0).integers(70, 160, (HEIGHT // 8 + 2, WIDTH // 8 + 2), dtype=np.int32)
    fine = np.kron(coarse, np.ones((8, 8), np.int32))
    smooth = sum(np.roll(fine, (down, right), (0, 1)) for down in range(8) for right in range(8)) // 64
    return np.repeat(smooth[None, 8 : 8 + HEIGHT, 8 : 8 + WIDTH], 3, 0)


def square(image: Image, top: int, left: int, color: tuple[int, int, int]) -> None:
    """Draw a square, cut off at the edges of the image."""
    rows, columns = (slice(max(0, at), max(0, at + SIDE)) for at in (top, left))
    image[:, rows, columns] = np.array(color, np.int32)[:, None, None]


def crossing(image: Image, n: int) -> None:
    """Red goes right and green goes left; they meet in the middle, where red is in front."""
    square(image, 50, WIDTH - 3 * (n - 20), GREEN)
    square(image, 42, -SIDE + 3 * (n - 20), RED)


def stopping(image: Image, n: int) -> None:
    """Blue enters, stops after 4 s and stays; a minute later red passes above it."""
    square(image, 64, -SIDE + 4 * (min(n, 50) - 20), BLUE)
    square(image, 8, -SIDE + 5 * (n - 680), RED)


def shadowed(image: Image, n: int) -> None:
    """Yellow with a shadow of three fifths of the light on the ground beside and below it."""
    top, left = 30, -2 * SIDE + 3 * (n - 20)
    rows, columns = slice(top + 10, top + SIDE + 18), slice(max(0, left - 8), max(0, left + SIDE + 26))
    image[:, rows, columns] = image[:, rows, columns] * 3 // 5
    square(image, top, left, YELLOW)


def leaving(image: Image, n: int) -> None:
    """Red leaves on the right, comes back two seconds later and leaves on the left; green goes down, blue goes up."""
    square(image, 12, 20 + 4 * n if n < 95 else WIDTH - 4 * (n - 95), RED)
    square(image, -SIDE + 2 * (n - 40), 40, GREEN)
    square(image, HEIGHT - 3 * (n - 30), 110, BLUE)


def occluded(image: Image, n: int) -> None:
    """Red passes behind a pillar and comes out as the same object; green swings to and fro above."""
    square(image, 60, -SIDE + 3 * (n - 20), RED)
    image[:, 36:, 80:134] = 60
    square(image, 4, 40 + abs((2 * n) % 120 - 60), GREEN)


def relit(image: Image, n: int) -> None:
    """Green passes while the light falls by a third from one frame to the next, and then slowly comes back."""
    square(image, 40, -SIDE + 2 * (n - 25), GREEN)
    share = 30 if n < 70 else min(30, 20 + (n - 70) // 5)
    image[:] = image * share // 30


CLIPS = {
    "crossing": Clip(25.0, 120, crossing),
    "stopping": Clip(10.0, 750, stopping),
    "shadowed": Clip(25.0, 120, shadowed),
    "leaving": Clip(25.0, 160, leaving),
    "occluded": Clip(25.0, 130, occluded),
    "relit": Clip(25.0, 150, relit),
}
