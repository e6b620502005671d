"""How a bar's signals fluctuate in time: through shadow, or by coming nearer and going away. [B §3.4.3]"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from ndtorch.arguments import check_number
from ndtorch.errors import InputError
from ndtorch.scenes.base import PerBar, check_seed, numbers


class Fluctuation:
    """Bars that do not fluctuate: steady light and steady size, so nothing separates them but their places.

    The kinds below change one of the two methods. `*batch` is empty or `[B]`, and `bars` may be 1 where
    all bars share the values.
    """

    def light(self, size: tuple[int, int]) -> Tensor:
        """Factor on the color at each pixel center, `[*batch, bars, H or 1, W]` float32."""
        return torch.ones(1, 1, size[1])

    def scale(self, seconds: Tensor) -> Tensor:
        """Factor on length and width, at most 1, at times `[T]` float64: `[*batch, bars, T]` float64."""
        return torch.ones(1, len(seconds), dtype=torch.float64, device=seconds.device)


class SineShadow(Fluctuation):
    """Light `mean + amplitude sin(2 pi x / period + phase)` over the columns x, alike in all rows. [B §3.4.1]

    Args:
        period: pixels a cycle.
        mean, amplitude: of the factor; both together must leave it in 0..1.
        phase: degrees at x = 0.

    `period` and `phase` may differ between bars and scenes (see `PerBar`).

    Raises:
        InputError: a period that is not positive, or light outside 0..1.
    """

    def __init__(self, period: PerBar = 50.0, mean: float = 0.5, amplitude: float = 0.25, phase: PerBar = 0.0) -> None:
        self.period, self.phase = numbers("period", period, 2, 1), numbers("phase", phase, 2, 1)
        self.mean, self.amplitude = mean, amplitude
        if not bool((self.period > 0).all()):
            raise InputError(f"period must be positive pixels, got {period}")
        if not (mean - abs(amplitude) >= 0 and mean + abs(amplitude) <= 1):
            raise InputError(f"mean +- amplitude must lie in 0..1, got {mean} +- {amplitude}")

    def light(self, size: tuple[int, int]) -> Tensor:
        x = torch.arange(size[1], dtype=torch.float64)
        angle = 2 * math.pi * x / self.period[..., None] + torch.deg2rad(self.phase)[..., None]
        return (self.mean + self.amplitude * torch.sin(angle)).float().unsqueeze(-2)


class RandomShadow(Fluctuation):
    """Dappled light: uniform noise blurred twice by a wrapped Gaussian, scaled to a range. [B §3.4.3]

    Args:
        seed: fixes the pattern; several seeds make a batch of scenes, one pattern each.
        sigma: standard deviation of each blur in pixels.
        lowest, highest: range of the factor.

    Raises:
        InputError: no seed, a negative sigma, or a range outside 0..1.
    """

    def __init__(
        self, seed: int | Sequence[int] = 0, sigma: float = 6.0, lowest: float = 0.25, highest: float = 0.75
    ) -> None:
        check_seed(seed)
        self.batched = isinstance(seed, Sequence)
        self.seeds = [int(one) for one in (seed if isinstance(seed, Sequence) else [seed])]
        self.sigma, self.lowest, self.highest = sigma, lowest, highest
        check_number("sigma", sigma, least=0, unit="pixels")
        if not 0 <= lowest < highest <= 1:
            raise InputError(f"lowest and highest must be in order within 0..1, got {lowest} and {highest}")

    def light(self, size: tuple[int, int]) -> Tensor:
        patterns = torch.stack([self._pattern(seed, size) for seed in self.seeds]).unsqueeze(1)
        return patterns if self.batched else patterns[0]

    def _pattern(self, seed: int, size: tuple[int, int]) -> Tensor:
        noise = torch.rand(size, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
        # Two wrapped blurs of sigma are one product with exp(-(2 pi f sigma)^2) in the frequency domain.
        rows, columns = torch.fft.fftfreq(size[0]), torch.fft.rfftfreq(size[1])
        squared = rows.double()[:, None] ** 2 + columns.double() ** 2
        spectrum = torch.fft.rfft2(noise) * torch.exp(-((2 * math.pi * self.sigma) ** 2) * squared)
        smooth = torch.fft.irfft2(spectrum, s=size)
        low, high = smooth.min(), smooth.max()
        pattern: Tensor = self.lowest + (self.highest - self.lowest) * (smooth - low) / (high - low)
        return pattern.float()


class Distance(Fluctuation):
    """Bars that come and go: length and width shrink from full size to `smallest` of it and back. [B §3.4.3]

    The factor is `(1 + smallest)/2 + (1 - smallest)/2 sin(2 pi rate t + phase)`.

    Args:
        rate: cycles a second.
        phase: degrees at t = 0; bars are separated only if they are out of phase.
        smallest: width farthest away as a part of the full width; 9 of 12 pixels in the paper.

    `rate` and `phase` may differ between bars and scenes (see `PerBar`).

    Raises:
        InputError: `smallest` outside (0, 1].
    """

    def __init__(self, rate: PerBar = 1.0, phase: PerBar = 0.0, smallest: float = 9 / 12) -> None:
        self.rate, self.phase = numbers("rate", rate, 2, 1), numbers("phase", phase, 2, 1)
        self.smallest = smallest
        if not 0 < smallest <= 1:
            raise InputError(f"smallest must be a part of the full size in (0, 1], got {smallest}")

    def scale(self, seconds: Tensor) -> Tensor:
        rate, phase = self.rate.to(seconds.device), torch.deg2rad(self.phase).to(seconds.device)
        # One time at a time: a vectorised sine may round the last elements of a row otherwise than the
        # first, and a frame must not depend on its place in the chunk.
        wave = torch.stack([torch.sin(2 * math.pi * (rate * t) + phase) for t in seconds.unbind()], -1)
        return (1 + self.smallest) / 2 + (1 - self.smallest) / 2 * wave
