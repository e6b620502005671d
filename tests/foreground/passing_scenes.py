"""Small video for the tests of the front end: a textured ground and a colored square."""

from __future__ import annotations

import torch
from torch import Tensor

SIZE = (112, 200)


def ground(seed: int = 0) -> Tensor:
    """A textured grey ground `[3, H, W]`."""
    generator = torch.Generator().manual_seed(seed)
    coarse = torch.rand(1, 1, 15, 26, generator=generator)
    fine = torch.nn.functional.interpolate(coarse, SIZE, mode="bilinear")[0, 0]
    return (0.35 + 0.2 * fine).expand(3, *SIZE).clone()


def passing(frames: int, step: float, color: tuple[float, float, float] = (0.8, 0.2, 0.2), first: int = 8) -> Tensor:
    """A square of 24 pixels that starts at the left edge in frame `first` and moves to the right, `[T, 3, H, W]`."""
    video = ground().repeat(frames, 1, 1, 1)
    for n in range(first, frames):
        left = round(step * (n - first))
        video[n, :, 44:68, left : left + 24] = torch.tensor(color)[:, None, None]
    return video
