"""Square gratings that move or flicker past a row camera, to characterise speed sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from ndtorch.arguments import check_number
from ndtorch.errors import InputError
from ndtorch.scenes.base import RenderedScene


def bar_coverage(position: Tensor, bar: float, period: float, width: int) -> Tensor:
    """Share of every pixel that the bright bars of a grating cover, `[..., width]` in 0..1.

    Bright bars lie at `position + k period .. position + k period + bar` for every whole k; pixel n reaches
    from n to n + 1. This is the anti-aliasing of [A Methods]: edge pixels are shaded by the exact place of
    the edge.
    """

    def covered_until(x: Tensor) -> Tensor:
        cycles = torch.floor(x / period)
        return cycles * bar + (x - cycles * period).clamp(max=bar)

    edges = torch.arange(width + 1, dtype=position.dtype, device=position.device) - position.unsqueeze(-1)
    return covered_until(edges).diff(dim=-1)


class MovingGrating(RenderedScene):
    """Rows of a square grating that moves at a constant speed, one row camera for each speed and phase.

    [A Methods]: 640 pixels, bars of 10 pixels 10 pixels apart, Michelson contrast 0.5 (intensities 0.25 and
    0.75), 30 frames a second, anti-aliased, speeds -2 to 2 pixels a step.
    Frames are grey rows `[S, P, T, 1, 1, width]` (S speeds, P start phases).

    Args:
        speeds: pixels per time step, to the right when positive; any real numbers.
        phases: places of the first bright bar's left edge at frame 0, in pixels. Whole numbers alone hide
            what happens below a pixel.
        bar, gap: widths of the bright bars and of the space between, in pixels.
        dark, bright: the two intensities; (bright - dark) / (bright + dark) is the Michelson contrast.
        width, fps, length: pixels in a row, frames a second, number of frames.

    Raises:
        InputError: no speed or phase, a number that is not finite, or sizes that are not positive.
    """

    def __init__(
        self,
        speeds: Sequence[float],
        phases: Sequence[float] = (0.0,),
        *,
        bar: float = 10.0,
        gap: float = 10.0,
        dark: float = 0.25,
        bright: float = 0.75,
        width: int = 640,
        fps: float = 30.0,
        length: int = 201,
    ) -> None:
        if len(speeds) == 0 or len(phases) == 0 or not all(map(math.isfinite, (*speeds, *phases))):
            raise InputError("speeds and phases must be at least one finite number each")
        for name, number in (("bar", bar), ("gap", gap), ("dark", dark), ("bright", bright), ("fps", fps)):
            check_number(name, number)
        check_number("length", length, above=0, whole=True)
        if not (bar > 0 and gap >= 0 and fps > 0):
            raise InputError(f"sizes must be positive: bar={bar}, gap={gap}, fps={fps}")
        super().__init__("moving-grating", length / fps, fps, (1, width))
        self.bar, self.period, self.dark, self.bright = bar, bar + gap, dark, bright
        self.speeds = torch.tensor(list(speeds), dtype=torch.float64)
        self.phases = torch.tensor(list(phases), dtype=torch.float64)

    def frames(self, start: int, stop: int) -> Tensor:
        # Double precision for the places, so that frame 10 000 is as well placed as frame 0.
        position = self.phases[:, None] + self.speeds[:, None, None] * torch.arange(start, stop, dtype=torch.float64)
        light = self.dark + (self.bright - self.dark) * bar_coverage(position, self.bar, self.period, self.size[1])
        return light.to(torch.get_default_dtype())[..., None, None, :]


class FlickeringGrating(RenderedScene):
    """The grating of `MovingGrating` at rest, or a uniform row; its light is multiplied by a sinusoid between 0 and 1.
    [A Methods]

    14.9 Hz at 30 frames a second, just below the Nyquist rate, excites the non-directional sensors most.
    Frames are grey rows `[T, 1, 1, width]`.

    Args:
        frequency: flicker frequency in Hz.
        uniform: a row of one intensity instead of the grating.
        width, fps, length: as of `MovingGrating`.

    Raises:
        InputError: numbers out of range.
    """

    def __init__(
        self, frequency: float = 14.9, *, uniform: bool = False, width: int = 640, fps: float = 30.0, length: int = 201
    ) -> None:
        check_number("frequency", frequency, least=0, unit="cycles a second")
        still = MovingGrating([0.0], gap=0.0 if uniform else 10.0, width=width, fps=fps, length=length)
        super().__init__("flickering-grating", length / fps, fps, (1, width))
        self.frequency, self._still = frequency, still.frames(0, 1)[0, 0].to(torch.float64)

    def frames(self, start: int, stop: int) -> Tensor:
        time = torch.arange(start, stop, dtype=torch.float64) / self.fps
        factor = 0.5 + 0.5 * torch.sin(2 * math.pi * self.frequency * time)
        return (factor[:, None, None, None] * self._still).to(torch.get_default_dtype())
