"""Contracting, flickering rings: the stimulus that trains the first stage. [B §2.3]"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ndtorch.arguments import check_number
from ndtorch.scenes.rendered import RenderedScene


class Rings(RenderedScene):
    """Contracting rings under a Gaussian envelope, flickering, grey in all three planes. [B eq. 25-27]

    `exp(-r² / (2 sigma²)) · (1 + sin Θ) / 2 · (1 + cos Ψ) / 2` with `Θ = 2 pi flicker t`,
    `Ψ = 2 pi (ring_frequency r + ring_rate t)`, r the distance in pixels from the middle of the image and
    t = frame number / fps. It drives all directions, orientations and colors alike.

    Shapes:
        frames `[T, 3, H, W]` float32 in 0..1.

    Raises:
        InputError: a `sigma` that is not positive, or what `RenderedScene` refuses.
    """

    def __init__(
        self,
        seconds: float,
        size: tuple[int, int] = (100, 100),
        fps: float = 100.0,
        sigma: float = 25.0,
        flicker: float = 0.5,
        ring_frequency: float = 0.2,
        ring_rate: float = 0.5,
        device: torch.device | str = "cpu",
    ) -> None:
        super().__init__("rings", seconds, fps, size, device)
        check_number("sigma", sigma, above=0, unit="pixels")
        for rate, value in (("flicker", flicker), ("ring_frequency", ring_frequency), ("ring_rate", ring_rate)):
            check_number(rate, value)
        self.flicker, self.ring_rate = flicker, ring_rate
        y = torch.arange(self.size[0], dtype=torch.float64)[:, None] - (self.size[0] - 1) / 2
        x = torch.arange(self.size[1], dtype=torch.float64) - (self.size[1] - 1) / 2
        r = torch.hypot(x, y)
        envelope, angle = torch.exp(-(r**2) / (2 * sigma**2)), 2 * math.pi * ring_frequency * r
        # cos(a + b) = cos a cos b - sin a sin b: the images are computed once, a frame mixes three of them.
        images = torch.stack([envelope, envelope * torch.cos(angle), envelope * torch.sin(angle)])
        self._images = images.float().to(self.device)

    def frames(self, start: int, stop: int) -> Tensor:
        """Frames number `start` to `stop - 1`, `[T, 3, H, W]` float32 in 0..1."""
        out = torch.zeros(max(0, stop - start), 3, *self.size, device=self.device)
        envelope, cosine, sine = self._images
        for frame, number in zip(out, range(start, stop), strict=True):
            time = number / self.fps
            brightness = (1 + math.sin(2 * math.pi * self.flicker * time)) / 4
            phase = 2 * math.pi * self.ring_rate * time
            grey = envelope + math.cos(phase) * cosine - math.sin(phase) * sine
            # Rounding may leave a dark ring a little below zero.
            frame[:] = (brightness * grey).clamp_(min=0.0)
        return out


def rings(
    seconds: float,
    size: tuple[int, int] = (100, 100),
    fps: float = 100.0,
    sigma: float = 25.0,
    flicker: float = 0.5,
    ring_frequency: float = 0.2,
    ring_rate: float = 0.5,
    device: torch.device | str = "cpu",
) -> Rings:
    """The ring stimulus as published; see `Rings` for the equation, shapes, units and errors. [B eq. 25-27]

    Args:
        seconds: duration.
        size: height and width in pixels.
        fps: frames a second.
        sigma: standard deviation of the envelope in pixels.
        flicker: cycles a second of the overall brightness.
        ring_frequency: rings a pixel.
        ring_rate: rings a second that shrink into the middle.
        device: where the frames are computed.
    """
    return Rings(seconds, size, fps, sigma, flicker, ring_frequency, ring_rate, device)
