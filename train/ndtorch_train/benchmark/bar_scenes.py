"""Seeded films of moving bars for the benchmark over time: grounds, noise, hues, sizes, speeds and frame rates."""

from __future__ import annotations

import colorsys
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

import ndtorch
from ndtorch.binding.network import settled
from ndtorch.binding.objects import features_by_group
from ndtorch.scenes import Bar, BarScene, three_bars, two_bars
from ndtorch.scenes.base import RenderedScene
from ndtorch_train.benchmark.base import Split
from ndtorch_train.superposed import rendered_sums

SECONDS = 45.0
"""Duration of every film."""
ALONE = 6.0
"""Seconds for which each bar is filmed alone to measure its features, from 2 s on."""
FIRST_SEED = {"tune": 0, "test": 1_000_000}
"""Scene n of condition k has this seed plus 1000 k + n; no seed is in both splits."""
FRAMES = (((120, 160), 30.0), ((200, 200), 30.0), ((160, 200), 60.0), ((300, 300), 30.0))
"""Size in pixels and frame rate of the films, in turn."""
DARKEST, BRIGHTEST = 0.25, 0.75
"""Range of a bar's brightness, that of the papers' shadow."""


@dataclass(frozen=True)
class FilmCondition:
    """What the films of one row of the table have in common.

    Attributes:
        bars: numbers of bars, in turn.
        hue_gap: smallest distance of two hues in degrees; 0: one hue for all bars.
        grey: the film has no color.
        one_orientation: all bars have the same orientation.
        noise: standard deviation of the pixel noise, full scale is 1.
        ground: mean brightness of the ground.
        texture: the ground is smooth colored noise, .15 around its mean.
        come_and_go: all bars but the first enter the film after its start and leave it before its end.
        paper: the papers' scenes, at any phase.
        in_step: the papers' scenes, the first two bars exactly in step or in opposite phase.
    """

    bars: tuple[int, ...] = (1, 2, 3)
    hue_gap: float = 60.0
    grey: bool = False
    one_orientation: bool = False
    noise: float = 0.0
    ground: float = 0.0
    texture: bool = False
    come_and_go: bool = False
    paper: bool = False
    in_step: bool = False


CONDITIONS: Mapping[str, FilmCondition] = {
    "black, 1 to 3 bars": FilmCondition(),
    "black, 4 bars": FilmCondition((4,)),
    "two_bars, any phase": FilmCondition((2,), paper=True),
    "three_bars, any phase": FilmCondition((3,), paper=True),
    "noise 0.2 %": FilmCondition(noise=0.002),
    "noise 1 %": FilmCondition(noise=0.01),
    "noise 2 %": FilmCondition(noise=0.02),
    "grey ground .2": FilmCondition(ground=0.2),
    "grey ground .4": FilmCondition(ground=0.4),
    "grey ground .6": FilmCondition(ground=0.6),
    "grey ground .4, noise 1 %": FilmCondition(ground=0.4, noise=0.01),
    "textured ground .2": FilmCondition(ground=0.2, texture=True),
    "textured ground .4": FilmCondition(ground=0.4, texture=True),
    "textured ground .6": FilmCondition(ground=0.6, texture=True),
    "hues 30° apart": FilmCondition((2, 3), hue_gap=30.0),
    "one hue, 2 orientations": FilmCondition((2,), hue_gap=0.0),
    "equal bars": FilmCondition((2, 3), hue_gap=0.0, one_orientation=True),
    "grey film": FilmCondition((1, 2, 3), grey=True),
    "bars come and go": FilmCondition((2, 3), come_and_go=True),
    "two_bars, three_bars in step": FilmCondition((2, 2, 3), in_step=True),
}
"""Rows of the table by name."""


class BarFilm(RenderedScene):
    """Bars over a ground, later ones over earlier ones, with pixel noise, rounded to 8 bits.

    Args:
        bars: each drawn bar by itself, from its own `BarScene` of one bar.
        light: brightness of each bar in every frame, `[K, T]`; None for that of the scenes' fluctuation.
        shown: seconds from which and until which each bar is in view.
        ground: `[3, H, W]`.
        noise: standard deviation.
        seed: of the noise.
    """

    def __init__(
        self,
        bars: Sequence[BarScene],
        light: Tensor | None,
        shown: Sequence[tuple[float, float]],
        ground: Tensor,
        noise: float = 0.0,
        seed: int = 0,
    ) -> None:
        super().__init__(f"bars-{seed}", SECONDS, bars[0].fps, bars[0].size)
        self.bars, self.light, self.shown, self.ground = bars, light, shown, ground
        self.noise, self.seed = noise, seed

    def frames(self, start: int, stop: int) -> Tensor:
        canvas = self.ground.flatten(1).repeat(stop - start, 1, 1)
        for k, (bar, (enters, leaves)) in enumerate(zip(self.bars, self.shown, strict=True)):
            first, last = max(start, math.ceil(enters * self.fps)), min(stop, math.ceil(leaves * self.fps))
            if first < last:
                light = None if self.light is None else [self.light[k, first:last]]
                bar.paint(canvas[first - start : last - start], torch.arange(first, last).double() / self.fps, light)
        if self.noise:
            generator = torch.Generator().manual_seed(1000 * self.seed + start)
            canvas += self.noise * torch.randn(canvas.shape, generator=generator)
        return (canvas.clamp_(0, 1) * 255).round_().div_(255).view(*canvas.shape[:-1], *self.size)

    def alone(self, k: int) -> BarFilm:
        """Bar k by itself on black, without noise."""
        light = None if self.light is None else self.light[k : k + 1]
        film = BarFilm(self.bars[k : k + 1], light, [(0, SECONDS)], torch.zeros_like(self.ground))
        film.length = round(ALONE * self.fps)
        return film


def draw_film(name: str, split: Split, number: int) -> BarFilm:
    """Film of a condition, by its number.

    Bars move in any direction at 20 to 150 pixels a second; half of them move across their long axis, the others have
    any orientation, 30° apart from each other's where bars have one hue or none. Brightness is a sine (period .5 to
    2.5 s), smoothed noise, or on and off.
    """
    c, seed = CONDITIONS[name], FIRST_SEED[split] + 1000 * list(CONDITIONS).index(name) + number
    rng, bars = np.random.default_rng(seed), c.bars[number % len(c.bars)]
    if c.paper or c.in_step:
        return paper_film(bars, 180 * (number % 2) if c.in_step else rng.uniform(0, 360), rng)
    size, fps = FRAMES[number % len(FRAMES)]
    length = rng.uniform(0.12, 0.16) * min(size)
    hues = apart(rng, bars, 360, c.hue_gap) if c.hue_gap else np.full(bars, rng.uniform(0, 360))
    tilts = apart(rng, bars, 180, 0.0 if c.hue_gap and not c.grey else 30.0)
    saturation = 0.0 if c.grey else rng.uniform(0.6, 1)
    drawn, light = [], []
    for n in range(bars):
        tilt = tilts[0] if c.one_orientation else tilts[n]
        direction = tilt + 180 * rng.integers(2) if rng.random() < 0.5 else rng.uniform(0, 360)
        color = colorsys.hsv_to_rgb(hues[n] / 360, saturation, 1.0)
        start = (rng.uniform(0, size[1]), rng.uniform(0, size[0]))
        bar = Bar(color, direction, start, tilt, rng.uniform(20, 150), length, max(4.0, length / 4))
        drawn.append(BarScene([bar], SECONDS, size=size, fps=fps))
        light.append(draw_light(rng, fps))
    shown = [(0.0, SECONDS)] * bars
    if c.come_and_go:
        shown[1:] = [(rng.uniform(8, 16), rng.uniform(26, 36)) for _ in shown[1:]]
    ground = torch.full((3, *size), c.ground)
    if c.texture:
        noise = torch.randn(1, 3, *size, generator=torch.Generator().manual_seed(seed))
        smooth = torch.nn.functional.avg_pool2d(torch.nn.functional.pad(noise, (4, 4, 4, 4), mode="circular"), 9, 1)[0]
        ground = (ground + 0.15 * smooth / smooth.std()).clamp(0, 1)
    return BarFilm(drawn, torch.from_numpy(np.stack(light)).float(), shown, ground, c.noise, seed)


def paper_film(bars: int, phase: float, rng: np.random.Generator) -> BarFilm:
    """The papers' two or three bars in the sine shadow, from other starting positions than theirs."""
    x, y = rng.uniform(-60, 60, 2)
    scene = (two_bars if bars == 2 else three_bars)(SECONDS, phase=phase, shift=(x, y), fps=25.0)
    single = [BarScene([bar], SECONDS, scene.fluctuation, scene.size, scene.fps) for bar in scene.bars]  # type: ignore[arg-type]
    return BarFilm(single, None, [(0, SECONDS)] * bars, torch.zeros(3, *scene.size))


def apart(rng: np.random.Generator, count: int, period: float, gap: float) -> np.ndarray:
    """Angles in a period, every two at least `gap` apart."""
    while True:
        angles = rng.uniform(0, period, count)
        distances = np.abs((angles[:, None] - angles + period / 2) % period - period / 2)
        if (distances[~np.eye(count, dtype=bool)] >= gap).all():
            return angles


def draw_light(rng: np.random.Generator, fps: float) -> np.ndarray:
    """Brightness over time, one value a frame."""
    time = np.arange(round(SECONDS * fps)) / fps
    middle, swing = (BRIGHTEST + DARKEST) / 2, (BRIGHTEST - DARKEST) / 2
    kind = rng.integers(3)
    if kind == 0:
        return np.asarray(middle + swing * np.sin(2 * np.pi * (time / rng.uniform(0.5, 2.5) + rng.random())))
    if kind == 1:
        sigma, white = rng.uniform(0.08, 0.3), np.fft.rfft(rng.standard_normal(len(time)))
        smooth = np.fft.irfft(
            white * np.exp(-0.5 * (2 * np.pi * np.fft.rfftfreq(len(time), 1 / fps) * sigma) ** 2), len(time)
        )
        return np.asarray((middle + 0.15 * (smooth - smooth.mean()) / smooth.std()).clip(0.05, 0.95))
    switches = np.cumsum(rng.uniform(0.4, 1.5, 200))
    on = np.searchsorted(switches, time + np.linspace(-0.05, 0.05, 11)[:, None]) % 2
    return np.asarray(DARKEST + (BRIGHTEST - DARKEST) * on.mean(0))


class Sums(NamedTuple):
    """The ten sums of a film, `[T, 10]`; the features of its bars, `[K, 10]` bool; and when each is in view."""

    sums: Tensor
    truth: Tensor
    shown: Sequence[tuple[float, float]]
    fps: float


def kept_sums(film: BarFilm, path: Path) -> Sums:
    """The sums and the truth of a film, from the file or computed and written there.

    The features of a bar are those of its own fluctuations, filmed alone on black, through the settled first stage:
    at least a third of the largest of their group.
    """
    if not path.exists():
        alone = [rendered_sums(film.alone(k))[round(2 * film.fps) :].std(0) for k in range(len(film.bars))]
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".part.npz")
        np.savez(partial, sums=rendered_sums(film).numpy(), alone=torch.stack(alone).numpy())
        partial.replace(path)
    with np.load(path) as kept:
        sums, deviations = torch.from_numpy(kept["sums"]), torch.from_numpy(kept["alone"])
    refined = features_by_group(deviations, 0.0) @ settled(first_stage()).mT
    return Sums(sums, features_by_group(refined) > 0, film.shown, film.fps)


@functools.cache
def first_stage() -> Tensor:
    """The trained first-stage weights, `[10, 10]`."""
    weights = ndtorch.load("published").first_stage()
    assert weights is not None
    return weights
