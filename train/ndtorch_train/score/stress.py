"""Random scenes made harder: noise, flicker, slow sampling, a change of scene, nothing moving, bars alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ndtorch.vision import GROUPS
from ndtorch_train.score.choices import SETTLE, Split
from ndtorch_train.score.scenes import FPS, Restriction, Scene, draw_light, draw_scene, seeds, superposed
from ndtorch_train.score.truth import true_features

SECONDS = 30.0
"""When a stress set is scored: seconds after settling. A change of scene comes half-way."""
FLICKER = 0.3
"""Fluctuation of a flickering background, as a share of each group's strongest signal."""


@dataclass(frozen=True)
class Stress:
    """A set of scenes under one difficulty.

    Attributes:
        name: for tables.
        description: what is done to the scenes.
        restriction: what their bars have in common.
        noise: white noise on every sum and sample, as a share of the standard deviation of its group's strongest sum
            (of its level, where nothing fluctuates).
        flicker: background that drives all colors and all orientations alike (see `FLICKER`).
        every: samples between frames: 3 is a frame each 30 ms.
        change: the scene gives way to another one half-way, and that one is scored.
    """

    name: str
    description: str
    restriction: Restriction = Restriction()  # noqa: RUF009
    noise: float = 0.0
    flicker: float = 0.0
    every: int = 1
    change: bool = False


STRESS: tuple[Stress, ...] = (
    Stress("plain", "random scenes as they are"),
    Stress("noise .03", "white noise on the sums, 3 % of each group's strongest", noise=0.03),
    Stress("noise .1", "10 %", noise=0.1),
    Stress("noise .3", "30 %", noise=0.3),
    Stress("flicker", "a background that brightens and darkens, in all colors and orientations", flicker=FLICKER),
    Stress("30 ms", "a frame every 30 ms", every=3),
    Stress("80 ms", "a frame every 80 ms", every=8),
    Stress("change", "other bars half-way", change=True),
    Stress("static", "nothing fluctuates", Restriction(steady=True)),
    Stress("static, noise .01", "nothing but white noise, 1 % of the level", Restriction(steady=True), noise=0.01),
    Stress("same direction", "2 or 3 bars alike in direction and orientation", Restriction(same_direction=True)),
    Stress("same color", "2 or 3 bars alike in color", Restriction(same_color=True)),
    Stress("four bars", "four bars", Restriction(bars=4)),
)


@dataclass(frozen=True)
class Trial:
    """Sums of many scenes, `[B, T, 10]` at `fps`, and the features of the bars of each, `[bars, 10]` bool."""

    sums: Tensor
    fps: float
    truth: list[Tensor]


def stressed(stress: Stress, split: Split, scenes: int, first_stage: Tensor) -> Trial:
    """Draw and superpose the scenes of a stress set."""
    chosen = drawn(stress, split, scenes)
    sums = superposed(chosen, SETTLE + SECONDS)
    shown = chosen
    if stress.change:
        shown = [draw_scene(scene.seed + 500_000, stress.restriction) for scene in chosen]
        half = round((SETTLE + SECONDS / 2) * FPS)
        sums[:, half:] = superposed(shown, SETTLE + SECONDS)[:, half:]
    if stress.flicker:
        sums += stress.flicker * flickering(chosen, strongest(sums))
    if stress.noise:
        generators = [torch.Generator().manual_seed(scene.seed) for scene in chosen]
        white = torch.stack([torch.randn(sums.shape[1:], generator=generator) for generator in generators])
        level = sums.abs().mean(1, keepdim=True) if stress.restriction.steady else sums.std(1, keepdim=True)
        sums += stress.noise * group_largest(level) * white
    truth = (
        [torch.zeros(0, 10, dtype=torch.bool)] * scenes
        if stress.restriction.steady
        else true_features(shown, first_stage)
    )
    return Trial(sums[:, :: stress.every], FPS / stress.every, truth)


def drawn(stress: Stress, split: Split, scenes: int) -> list[Scene]:
    """The scenes; sets of bars that share something have two or three of them."""
    alike = stress.restriction.same_color or stress.restriction.same_direction
    found = []
    for seed in seeds(split, scenes):
        restriction = stress.restriction
        if alike:
            restriction = Restriction(2 + seed % 2, restriction.same_color, restriction.same_direction)
        found.append(draw_scene(seed, restriction))
    return found


def flickering(scenes: Sequence[Scene], size: Tensor) -> Tensor:
    """Smoothed noise of unit deviation times `size` `[B, 1, 10]` in all colors and orientations, `[B, T, 10]`."""
    total = torch.zeros(len(scenes), round((SETTLE + SECONDS) * FPS), 10)
    for n, scene in enumerate(scenes):
        light = torch.from_numpy(draw_light(np.random.default_rng(scene.seed + 250_000), "noise"))
        total[n, :, 4:] = ((light - light.mean()) / light.std())[: total.shape[1], None]
    return total * size


def strongest(sums: Tensor) -> Tensor:
    """Standard deviation of each group's most fluctuating sum, `[B, T, 10]` -> `[B, 1, 10]`."""
    return group_largest(sums.std(1, keepdim=True))


def group_largest(values: Tensor) -> Tensor:
    """Each group's largest value for all of its features, `[..., 10]`."""
    parts = [values[..., g].amax(-1, keepdim=True).expand_as(values[..., g]) for g in GROUPS.values()]
    return torch.cat(parts, -1)
