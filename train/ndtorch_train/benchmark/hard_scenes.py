"""Scenes made harder: many objects, faint ones, noise, lamps, shared light, other periods, objects that come and go."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from ndtorch.vision import GROUPS
from ndtorch_train.benchmark.bar_scenes import (
    BRIGHTEST,
    DARKEST,
    DIRECTIONS,
    FPS,
    LONGEST,
    NOISE_DEVIATION,
    ORIENTATIONS,
    SETTLE,
    SIZE,
    SWITCHING,
    Floats,
    RandomBar,
    Restriction,
    Scene,
    across,
    draw_light,
    draw_scene,
    first_stage,
    superposed,
    true_features,
)
from ndtorch_train.benchmark.base import Split


@dataclass(frozen=True)
class Trial:
    """Sums of many scenes, `[B, T, 10]` at `fps`, and the features of the bars of each, `[bars, 10]` bool."""

    sums: Tensor
    fps: float
    truth: list[Tensor]


def strongest(sums: Tensor) -> Tensor:
    """Standard deviation of each group's most fluctuating sum, `[B, T, 10]` -> `[B, 1, 10]`."""
    return group_largest(sums.std(1, keepdim=True))


def group_largest(values: Tensor) -> Tensor:
    """Each group's largest value for all of its features, `[..., 10]`."""
    parts = [values[..., g].amax(-1, keepdim=True).expand_as(values[..., g]) for g in GROUPS.values()]
    return torch.cat(parts, -1)


FIRST_SEED = {"tune": 10_000_000, "test": 11_000_000}
"""Scene i of set k has this seed plus 10 000 k + i."""
HARD_SECONDS = 15.0
AFTER = 8.0
"""Scenes in which objects come or leave are scored this long after they did."""
FADE = 0.5
"""Seconds in which an object comes or leaves: half of what a bar of 50 pixels needs to cross an edge at its pace."""

Change = Literal["", "leaves", "comes", "swap"]


@dataclass(frozen=True)
class HardSet:
    """A set of scenes under one difficulty.

    Attributes:
        name, description: for tables.
        bars: numbers of bars, in turn.
        contrast: the last bar's brightness, as a share of the others'.
        pace: shortest and longest period in seconds, None for that of the random scenes.
        common: all bars fluctuate as sinusoids of one period.
        shared: the brightness of all bars is multiplied by one more fluctuation, of half its mean.
        lamp: a light that drives all colors and orientations, in deviations of each group's strongest sum.
        white, smooth: noise on every sum by itself, white or smoothed over .1-.3 s, in the same unit.
        change: at 15 s one bar leaves, one comes, or all give way to others.
        every: samples of 10 ms between frames.
        lost: share of frames that do not arrive; the last one stays.
        steady: bars that do not fluctuate: there is nothing to find.
    """

    name: str
    description: str
    bars: tuple[int, ...] = (1, 2, 3)
    contrast: float = 1.0
    pace: tuple[float, float] | None = None
    common: bool = False
    shared: bool = False
    lamp: float = 0.0
    white: float = 0.0
    smooth: float = 0.0
    change: Change = ""
    every: int = 1
    lost: float = 0.0
    steady: bool = False

    @property
    def seconds(self) -> float:
        """When it is scored, after settling."""
        return HARD_SECONDS + (AFTER if self.change else 0.0)


HARD: tuple[HardSet, ...] = (
    *(HardSet(f"{n} objects", f"{n} bars, hues at least {360 // (n + 2)}° apart", (n,)) for n in (4, 5, 6)),
    *(HardSet(f"contrast x{c:g}", f"one of 2 or 3 bars {c:g} times as bright", (2, 3), c) for c in (0.5, 0.25, 0.1)),
    *(HardSet(f"white {s:g}", "white noise on every sum", white=s) for s in (0.03, 0.1, 0.3, 0.5)),
    *(HardSet(f"smooth {s:g}", "noise of .1-.3 s on every sum", smooth=s) for s in (0.03, 0.1, 0.3, 0.5)),
    HardSet("lamp", "a lamp as strong as the strongest sum", lamp=1.0),
    HardSet("shared light", "one more fluctuation of all bars together", (2, 3), shared=True),
    HardSet("slow", "periods of 4-10 s", pace=(4.0, 10.0)),
    HardSet("fast", "periods of .1-.3 s", pace=(0.1, 0.3)),
    HardSet("common period, 2", "two sinusoids of one period", (2,), common=True),
    HardSet("common period, 3", "three", (3,), common=True),
    HardSet("one leaves", "8 s after one of 2 or 3 has left", (2, 3), change="leaves"),
    HardSet("one comes", "8 s after one has come to 1 or 2", (2, 3), change="comes"),
    HardSet("all change", "8 s after all gave way to others", (1, 2, 3), change="swap"),
    HardSet("25/s, 5 % lost", "25 frames a second", every=4, lost=0.05),
    HardSet("12.5/s, 10 % lost", "12.5 frames a second", every=8, lost=0.1),
    HardSet("none", "nothing fluctuates", steady=True),
    HardSet("none, white", "nothing but white noise of 10 % of the level", steady=True, white=0.1),
    HardSet("none, smooth", "nothing but noise of .1-.3 s, 10 % of the level", steady=True, smooth=0.1),
    HardSet("none, lamp", "nothing but a lamp, 30 % of the level", steady=True, lamp=0.3),
)


@dataclass(frozen=True)
class HardScene:
    """Bars with their brightness over the whole time, and those among them that are there at the end."""

    scene: Scene
    shown: Scene


def hard_scenes(hard: HardSet, split: Split, scenes: int) -> list[HardScene]:
    """The scenes of a set."""
    first = FIRST_SEED[split] + 10_000 * HARD.index(hard)
    return [draw_hard(hard, first + n, hard.bars[n % len(hard.bars)]) for n in range(scenes)]


def draw_hard(hard: HardSet, seed: int, count: int) -> HardScene:
    """One scene of `count` bars."""
    rng = np.random.default_rng(seed)
    drawn = draw_bars(rng, hard, count)
    bars = [replace(bar, light=bar.light.copy()) for bar in drawn]
    if hard.shared:
        common = draw_light(rng, "noise")
        common = common / common.mean()
        bars = [replace(bar, light=(bar.light * common).clip(0.02, 1.0).astype(np.float32)) for bar in bars]
    if hard.contrast != 1.0:
        red, green, blue = (hard.contrast * part for part in bars[-1].color)
        bars[-1] = replace(bars[-1], color=(red, green, blue))
    shown = bars
    if hard.change:
        here = presence(SETTLE + HARD_SECONDS)
        later = draw_bars(rng, hard, count) if hard.change == "swap" else []
        gone = bars if hard.change == "swap" else bars[-1:] if hard.change == "leaves" else []
        come = later if hard.change == "swap" else bars[-1:] if hard.change == "comes" else []
        stay = [bar for bar in bars if not any(bar is other for other in [*gone, *come])]
        shown = [*stay, *come]
        bars = [
            *stay,
            *(replace(bar, light=bar.light * (1 - here)) for bar in gone),
            *(replace(bar, light=bar.light * here) for bar in come),
        ]
    return HardScene(Scene(seed, tuple(bars)), Scene(seed, () if hard.steady else tuple(shown)))


def draw_bars(rng: np.random.Generator, hard: HardSet, count: int) -> list[RandomBar]:
    """Bars like those of the random scenes, of more hues and other paces."""
    if count <= 3 and hard.pace is None and not hard.common:
        seed = int(rng.integers(2**31))
        return list(draw_scene(seed, Restriction(count, steady=hard.steady)).bars)
    hues, gap = np.zeros(0), 360 // (count + 2)
    while len(hues) == 0 or apart(hues) < gap:
        hues = rng.uniform(0, 360, count)
    period, phase = rng.uniform(0.5, 2.5), rng.uniform(0, 2 * math.pi)
    bars = []
    for n in range(count):
        direction = int(rng.integers(DIRECTIONS))
        free = int(rng.integers(ORIENTATIONS))
        orientation = across(direction) if rng.random() < 0.5 else free
        color = colorsys.hsv_to_rgb(float(hues[n]) / 360, float(rng.uniform(0.5, 0.95)), 1.0)
        start = (float(rng.uniform(0, SIZE[1])), float(rng.uniform(0, SIZE[0])))
        if hard.common:
            # Evenly around the cycle, give or take a tenth of it.
            light = sinusoid(period, phase + 2 * math.pi * ((n + rng.uniform(-0.1, 0.1)) / max(3, count)))
        else:
            low, high = hard.pace or (0.5, 2.5)
            light = paced(rng, low, high)
        bars.append(RandomBar(direction, orientation, color, start, light))
    return bars


def apart(hues: Floats | np.ndarray) -> float:
    """Smallest difference of any two hues, degrees."""
    gaps = np.abs((hues[:, None] - hues + 180) % 360 - 180)
    return float(gaps[~np.eye(len(hues), dtype=bool)].min()) if len(hues) > 1 else 180.0


def sinusoid(period: float, phase: float) -> Floats:
    """Brightness as a sinusoid, phase in radians."""
    time = np.arange(round(LONGEST * FPS)) / FPS
    light = (BRIGHTEST + DARKEST) / 2 + (BRIGHTEST - DARKEST) / 2 * np.sin(2 * math.pi * time / period + phase)
    drawn: Floats = light.astype(np.float32)
    return drawn


def paced(rng: np.random.Generator, low: float, high: float) -> Floats:
    """A sinusoid, smoothed noise or on-off brightness of a period between `low` and `high` seconds."""
    kind, period = int(rng.integers(3)), float(rng.uniform(low, high))
    if kind == 0:
        return sinusoid(period, rng.uniform(0, 2 * math.pi))
    samples = round(LONGEST * FPS)
    if kind == 1:
        light = 0.5 + NOISE_DEVIATION * smoothed(rng, period / 8, samples)[:, 0]
        clipped: Floats = light.clip(0.05, 0.95).astype(np.float32)
        return clipped
    lengths = np.round(FPS * rng.uniform(0.3, 0.7, math.ceil(LONGEST / (0.3 * period)) + 1) * period).astype(int)
    on = (np.arange(len(lengths)) + rng.integers(2)) % 2
    light = np.repeat(DARKEST + (BRIGHTEST - DARKEST) * on, lengths.clip(1))
    ramp = max(1, round(min(SWITCHING, period / 5) * FPS))
    ramped: Floats = np.convolve(light, np.full(ramp, 1 / ramp), mode="valid")[:samples].astype(np.float32)
    return ramped


def smoothed(rng: np.random.Generator, sigma: float, samples: int, signals: int = 1) -> Floats:
    """Noise of unit deviation, smoothed by a Gaussian of `sigma` seconds, `[samples, signals]`."""
    spectrum = np.fft.rfft(rng.standard_normal((samples, signals)), axis=0)
    gain = np.exp(-0.5 * (2 * math.pi * np.fft.rfftfreq(samples, 1 / FPS) * sigma) ** 2)
    smooth = np.fft.irfft(spectrum * gain[:, None], samples, axis=0)
    scaled: Floats = ((smooth - smooth.mean(0)) / smooth.std(0)).astype(np.float32)
    return scaled


def presence(moment: float) -> Floats:
    """From 0 to 1 at `moment`, seconds from the first frame."""
    time = np.arange(round(LONGEST * FPS)) / FPS
    return ((time - moment) / FADE).clip(0, 1).astype(np.float32)


def hard_trial(hard: HardSet, split: Split, scenes: int) -> Trial:
    """Draw and superpose the scenes of a set."""
    chosen = hard_scenes(hard, split, scenes)
    sums = superposed([one.scene for one in chosen], SETTLE + hard.seconds)
    sums += disturbance(hard, [one.scene.seed for one in chosen], sums)
    truth = [true_features([one.shown], first_stage())[0] if one.shown.bars else no_bars() for one in chosen]
    kept = arrived(hard, [one.scene.seed for one in chosen], sums.shape[1], hard.every)
    seen = torch.stack([scene[at] for scene, at in zip(sums, kept, strict=True)])
    return Trial(seen, FPS / hard.every, truth)


def disturbance(hard: HardSet, seeds: Sequence[int], sums: Tensor) -> Tensor:
    """What comes to the sums `[B, T, 10]` beside the bars: a lamp and noise of both kinds."""
    level = group_largest(sums.abs().mean(1, keepdim=True)) if hard.steady else strongest(sums)
    parts = []
    for seed in seeds:
        rng, samples = np.random.default_rng(seed + 500_000_000), sums.shape[1]
        part = np.zeros((samples, 10), np.float32)
        if hard.white:
            part += hard.white * rng.standard_normal(part.shape).astype(np.float32)
        if hard.smooth:
            for n in range(10):
                part[:, n] += hard.smooth * smoothed(rng, rng.uniform(0.1, 0.3), samples)[:, 0]
        if hard.lamp:
            part[:, 4:] += hard.lamp * smoothed(rng, rng.uniform(0.08, 0.3), samples)
        parts.append(torch.from_numpy(part))
    return level * torch.stack(parts)


def arrived(hard: HardSet, seeds: Sequence[int], samples: int, every: int) -> list[Tensor]:
    """Which sample is there at every frame, one for `every` samples: the latest that arrived."""
    frames = torch.arange(0, samples, every)
    found = []
    for seed in seeds:
        lost = np.random.default_rng(seed + 700_000_000).random(len(frames)) < hard.lost
        lost[0] = False
        latest = torch.from_numpy(np.maximum.accumulate(np.where(lost, 0, np.arange(len(frames)))))
        found.append(frames[latest])
    return found


def no_bars() -> Tensor:
    """The truth where there is nothing to find."""
    return torch.zeros(0, 10, dtype=torch.bool)
