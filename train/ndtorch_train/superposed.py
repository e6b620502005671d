"""Features of bars in the sine shadow, superposed from films of each bar alone.

A lone bar's sums repeat with every period of the shadow. One period is filmed for each bar in a small image; starting
phases shift it in time, and scenes add bars up. Against rendered scenes colors agree within 0.1 % of their largest
and motion within 1 %, for the bars' places between the pixels. Orientation differs by up to 5 %, because the wide
filters of bars that pass each other overlap, and |a + b| is not |a| + |b|. Bars that touch would differ more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.scenes import FrameSource, SineShadow, three_bars
from ndtorch.scenes.bars import Bar, BarScene
from ndtorch.vision import VisualFeatures

SIZE = 200
"""Side of the image a lone bar is filmed in: four periods of the shadow, and room for the whole filter."""

PERIOD = 50.0
"""Pixels a cycle of the shadow."""

SETTLED = 3.0
"""Seconds before a film counts: six time constants of the motion detectors."""

DT = 0.01


class LoneBar(NamedTuple):
    """Sums `[samples, 10]` of one bar every 10 ms over a little more than a period, `SETTLED` after its start at x."""

    sums: Tensor
    x: float
    speed: float

    @property
    def period(self) -> float:
        """Seconds between two dark places."""
        return PERIOD / abs(self.speed)

    def at(self, x: Tensor, seconds: float) -> Tensor:
        """Sums every 10 ms of such bars that start at columns x `[...]`: `[..., T, 10]`."""
        steps = round(seconds / DT)
        t = torch.arange(steps, dtype=torch.float64) * DT
        # Where the film was when it was at the same place in the shadow.
        place = (x.double().unsqueeze(-1) - self.x) / self.speed + t - SETTLED
        samples = (place % self.period) / DT
        left = samples.floor().long()
        share = (samples - left).float().unsqueeze(-1)
        return torch.lerp(self.sums[left], self.sums[left + 1], share)


def rendered_sums(scene: FrameSource) -> Tensor:
    """The ten sums of every frame of a scene, `[T, 10]`."""
    features, state, sums = VisualFeatures(scene.size, 1 / scene.fps), None, list[Tensor]()
    with torch.inference_mode():
        for frames in scene.chunks(8):
            out, state = features(frames, state)
            sums.append(out)
    return torch.cat(sums)


def film_alone(bar: Bar) -> LoneBar:
    """Film one bar in the sine shadow, 100 frames a second."""
    speed = bar.speed * math.cos(math.radians(bar.direction))
    start = (bar.start[0] % SIZE, bar.start[1] % SIZE)
    alone = Bar(bar.color, bar.direction, start, bar.orientation, bar.speed, bar.length, bar.width)
    # Two samples more than a period: one for rounding, one to interpolate to.
    seconds = SETTLED + PERIOD / abs(speed) + 3 * DT
    scene = BarScene([alone], seconds, SineShadow(PERIOD), (SIZE, SIZE))
    sums = rendered_sums(scene)
    return LoneBar(sums[round(SETTLED / DT) :].clone(), start[0], speed)


class Stimuli(NamedTuple):
    """Films of the red, green and blue bar of `three_bars`, each alone; their sums at any starting phases."""

    bars: tuple[LoneBar, LoneBar, LoneBar]

    def red(self, seconds: float) -> Tensor:
        """The red bar, `[T, 10]`."""
        return self.bars[0].at(torch.tensor(start_of(0, 0.0, 0.0)), seconds)

    def green(self, phases: Sequence[float], seconds: float) -> Tensor:
        """The green bar at each lead over the red one in degrees, `[phases, T, 10]`."""
        return self.bars[1].at(torch.tensor([start_of(1, phase, 0.0) for phase in phases]), seconds)

    def blue(self, offsets: Sequence[float], seconds: float) -> Tensor:
        """The blue bar at each offset in pixels, `[offsets, T, 10]`."""
        return self.bars[2].at(torch.tensor([start_of(2, 0.0, offset) for offset in offsets]), seconds)


def film_bars() -> Stimuli:
    """Film each of the three bars."""
    red, green, blue = (film_alone(bar) for bar in three_bars(1.0).bars)  # type: ignore[arg-type]
    return Stimuli((red, green, blue))


def start_of(index: int, phase: float, offset: float) -> float:
    """Column at which a bar of `three_bars` starts."""
    bar = three_bars(1.0, phase=float(phase), blue_offset=float(offset)).bars[index]
    assert isinstance(bar, Bar)
    return bar.start[0]
