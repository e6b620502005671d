"""Seeded random scenes of moving bars: as ten sums superposed of single bars, as rendered frames, and their truth.

`python -m ndtorch_train.benchmark.bar_scenes` measures the single bars again and writes `single_bars.csv`.
"""

from __future__ import annotations

import colorsys
import csv
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

import ndtorch
from ndtorch.binding.learning import settled
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.errors import InputError
from ndtorch.scenes import Bar, BarScene
from ndtorch.scenes.base import RenderedScene
from ndtorch.vision import FEATURES, GROUPS, VisualFeatures
from ndtorch.vision.blocks import BLOCK, BlockLowPass, low_pass
from ndtorch.vision.temporal import smoothing_factor
from ndtorch_train.benchmark.base import Split

Floats = npt.NDArray[np.float32]

FPS = 100.0
SIZE = (500, 500)
FIRST_SEED = {"tune": 0, "test": 1_000_000}
"""Scene i of a split has this seed plus i."""
MOST_SCENES = 1_000_000
TAU_DELAY = 0.05
"""Delay filter of the motion detectors, seconds."""
DARKEST, BRIGHTEST = 0.25, 0.75
"""Range of a bar's brightness, that of the papers' shadow."""
NOISE_DEVIATION = 0.15
SWITCHING = 0.1
"""Seconds that on-off brightness takes to change: a bar needs .24 s to cross the edge of a shadow."""
HUE_GAP = 60.0
Kind = Literal["sine", "noise", "on-off", "steady"]
KINDS: tuple[Kind, ...] = ("sine", "noise", "on-off")

SETTLE = 4.0
"""Seconds every method gets before the clock of the score starts, as in the papers."""
LONGEST = 104.0
"""Seconds of brightness drawn for every scene, so that a scene does not depend on how long it is watched."""
PRESENT = 1 / 3
"""Share of its group's largest from which on a feature belongs to an object."""

TABLE = Path(__file__).with_name("single_bars.csv")
DIRECTIONS = 16
ORIENTATIONS = 8
LENGTH, WIDTH, SPEED = 50.0, 12.0, 50.0
# The motion filters keep half a second; what is averaged covers every sub-pixel position.
RISE, AVERAGED = 200, 40
BAR_CANVAS = 320


def direction_degrees(index: int) -> float:
    """Direction of motion number `index`, counter-clockwise from right."""
    return 360 / DIRECTIONS * index


def orientation_degrees(index: int) -> float:
    """Orientation number `index`, counter-clockwise, 0 = long axis vertical."""
    return 180 / ORIENTATIONS * index


def across(direction: int) -> int:
    """The orientation of a bar that moves across its long axis in that direction."""
    return direction % ORIENTATIONS


def measure_bar(direction: int, orientation: int, size: int = BAR_CANVAS) -> Tensor:
    """Mean sums of a white bar of steady full brightness, `[10]`, from `AVERAGED` rendered frames."""
    bar = Bar(
        (1.0, 1.0, 1.0),
        direction_degrees(direction),
        (size / 2, size / 2),
        orientation_degrees(orientation),
        SPEED,
        LENGTH,
        WIDTH,
    )
    scene = BarScene([bar], (RISE + AVERAGED) / 100, size=(size, size))
    features = VisualFeatures((size, size), exact=False)
    state, kept = None, []
    with torch.inference_mode():
        for n, frames in enumerate(scene.chunks(8)):
            if 8 * (n + 1) <= RISE:
                _, _, state = features.motion.scan(frames.mean(-3), state)
            else:
                sums, state = features(frames, state)
                kept.append(sums)
    mean: Tensor = torch.cat(kept).mean(0)
    return mean


@functools.cache
def single_bars() -> Tensor:
    """The measured table, `[DIRECTIONS, ORIENTATIONS, 10]`."""
    table = torch.zeros(DIRECTIONS, ORIENTATIONS, 10)
    with TABLE.open(encoding="utf-8") as file:
        for direction, orientation, *sums in list(csv.reader(file))[1:]:
            table[int(direction), int(orientation)] = torch.tensor([float(value) for value in sums])
    return table


@dataclass(frozen=True)
class RandomBar:
    """A bar of 50 x 12 pixels at 50 pixels a second.

    Attributes:
        direction, orientation: numbers, see `single_bars`.
        color: red, green and blue in 0..1.
        start: column and row of the center in the first frame (for rendering; sums do not depend on it).
        light: brightness over time at 100 samples a second, `[LONGEST * 100]`.
    """

    direction: int
    orientation: int
    color: tuple[float, float, float]
    start: tuple[float, float]
    light: Floats = field(repr=False)


@dataclass(frozen=True)
class Scene:
    """The bars in view, and the seed they were drawn with."""

    seed: int
    bars: tuple[RandomBar, ...]


@dataclass(frozen=True)
class Restriction:
    """What the bars of a drawn scene have in common.

    Attributes:
        bars: how many; None takes 1, 2, 3 in turn with the seed.
        same_color, same_direction: all bars take the first one's color, or its direction and orientation.
        steady: nothing fluctuates.
    """

    bars: int | None = None
    same_color: bool = False
    same_direction: bool = False
    steady: bool = False


def seeds(split: Split, scenes: int) -> range:
    """The seeds of the first `scenes` scenes of a split; the two splits have none in common."""
    if split not in FIRST_SEED:
        raise InputError(f"split must be tune or test, got {split!r}")
    if not 1 <= scenes <= MOST_SCENES:
        raise InputError(f"scenes must be between 1 and {MOST_SCENES}, got {scenes}")
    return range(FIRST_SEED[split], FIRST_SEED[split] + scenes)


def draw_scene(seed: int, restriction: Restriction | None = None, seconds: float = LONGEST) -> Scene:
    """The scene of that seed: 1-3 bars of random direction, orientation, color and brightness over time.

    16 directions; half of the bars move across their long axis, the others have one of 8 orientations. Colors are
    fully bright, of saturation .5-.95 and hues at least 60° apart. Brightness is a sinusoid (period .5-2.5 s), smoothed
    noise (Gaussian of .08-.3 s) or on-off (.4-1.5 s each), around one half, for so many `seconds`: another number of
    them draws another scene.
    """
    want = restriction or Restriction()
    rng = np.random.default_rng(seed)
    count = want.bars or seed % 3 + 1
    hues = draw_hues(rng, count)
    bars: list[RandomBar] = []
    for n in range(count):
        direction = int(rng.integers(DIRECTIONS))
        free = int(rng.integers(ORIENTATIONS))
        orientation = across(direction) if rng.random() < 0.5 else free
        color = colorsys.hsv_to_rgb(hues[n] / 360, rng.uniform(0.5, 0.95), 1.0)
        start = (float(rng.uniform(0, SIZE[1])), float(rng.uniform(0, SIZE[0])))
        kind: Kind = "steady" if want.steady else KINDS[rng.integers(len(KINDS))]
        light = draw_light(rng, kind, seconds)
        if bars and want.same_color:
            color = bars[0].color
        if bars and want.same_direction:
            direction, orientation = bars[0].direction, bars[0].orientation
        bars.append(RandomBar(direction, orientation, color, start, light))
    return Scene(seed, tuple(bars))


@dataclass(frozen=True)
class SceneSet:
    """A set of scenes.

    Attributes:
        name: for tables.
        restriction: what the bars of a scene have in common.
        bars: numbers of bars, in turn with the seed.
    """

    name: str
    restriction: Restriction
    bars: tuple[int, ...]


RANDOM = SceneSet("random", Restriction(), (1, 2, 3))
ALIKE = (
    SceneSet("four bars", Restriction(), (4,)),
    SceneSet("same color", Restriction(same_color=True), (2, 3)),
    SceneSet("same direction", Restriction(same_direction=True), (2, 3)),
    SceneSet("equal bars", Restriction(same_color=True, same_direction=True), (2, 3)),
)


def scenes_of(chosen: SceneSet, split: Split, scenes: int) -> list[Scene]:
    """The scenes of a set."""
    r = chosen.restriction
    return [
        draw_scene(seed, Restriction(chosen.bars[seed % len(chosen.bars)], r.same_color, r.same_direction))
        for seed in seeds(split, scenes)
    ]


def draw_hues(rng: np.random.Generator, count: int) -> Floats:
    """Hues in degrees, every two at least `HUE_GAP` apart."""
    while True:
        hues = rng.uniform(0, 360, count)
        gaps = np.abs(hues[:, None] - hues + 180) % 360 - 180
        if (np.abs(gaps)[~np.eye(count, dtype=bool)] >= HUE_GAP).all():
            return hues.astype(np.float32)


def draw_light(rng: np.random.Generator, kind: Kind, seconds: float = LONGEST) -> Floats:
    """Brightness over time, 100 samples a second."""
    samples = round(seconds * FPS)
    middle, swing = (BRIGHTEST + DARKEST) / 2, (BRIGHTEST - DARKEST) / 2
    if kind == "sine":
        period, phase = rng.uniform(0.5, 2.5), rng.uniform(0, 2 * math.pi)
        light = middle + swing * np.sin(2 * math.pi * np.arange(samples) / FPS / period + phase)
    elif kind == "noise":
        sigma = rng.uniform(0.08, 0.3)
        spectrum = np.fft.rfft(rng.standard_normal(samples))
        smooth = np.fft.irfft(spectrum * np.exp(-0.5 * (2 * math.pi * np.fft.rfftfreq(samples, 1 / FPS) * sigma) ** 2))
        smooth = (smooth - smooth.mean()) / smooth.std()
        light = (middle + NOISE_DEVIATION * smooth).clip(0.05, 0.95)
    elif kind == "on-off":
        shortest, longest = 0.4, 1.5
        lengths = np.round(FPS * rng.uniform(shortest, longest, math.ceil(seconds / shortest) + 1)).astype(int)
        on = (np.arange(len(lengths)) + rng.integers(2)) % 2
        light = np.repeat(DARKEST + (BRIGHTEST - DARKEST) * on, lengths)
        ramp = round(SWITCHING * FPS)
        light = np.convolve(light, np.full(ramp, 1 / ramp), mode="valid")[:samples]
    else:
        light = np.full(samples, middle)
    drawn: Floats = light.astype(np.float32)
    return drawn


def gains(bar: RandomBar) -> Tensor:
    """What the bar's brightness s adds to the ten sums, `[10]`: motion times s(t) LP(s)(t), the others times s(t)."""
    white = single_bars()[bar.direction, bar.orientation]
    color = torch.tensor(bar.color)
    grey = color.mean()
    motion, orientation, colors = (white[group] for group in GROUPS.values())
    return torch.cat([motion * grey**2, orientation * grey, colors * color])


def moving(light: Tensor) -> Tensor:
    """s(t) LP(s)(t), the brightness as the motion detectors take it, `[..., T]`."""
    slow, _ = low_pass(BlockLowPass(smoothing_factor(TAU_DELAY, 1 / FPS), BLOCK), light.unsqueeze(-1), light[..., :1])
    return light * slow.squeeze(-1)


def superposed(scenes: Sequence[Scene], seconds: float) -> Tensor:
    """The ten sums of every scene at 100 samples a second, `[B, T, 10]`."""
    steps = round(seconds * FPS)
    total, motion = torch.zeros(len(scenes), steps, 10), GROUPS["motion"]
    others = slice(motion.stop, None)
    # Scenes with equally many bars go through the filter together.
    for count in {len(scene.bars) for scene in scenes}:
        at = [n for n, scene in enumerate(scenes) if len(scene.bars) == count]
        light = torch.from_numpy(np.stack([[bar.light[:steps] for bar in scenes[n].bars] for n in at]))
        strength = torch.stack([torch.stack([gains(bar) for bar in scenes[n].bars]) for n in at])
        total[at] = torch.cat([moving(light).mT @ strength[..., motion], light.mT @ strength[..., others]], -1)
    return total


class RenderedBars(RenderedScene):
    """The same scene as frames: bars on a ground, later ones over earlier ones, each times its own brightness.

    Args:
        scene: the bars.
        seconds: of the film.
        fps: frames a second, of which `FPS` is a multiple.
        speed, length, width: of the bars, pixels a second and pixels.
    """

    def __init__(
        self,
        scene: Scene,
        seconds: float,
        fps: float = FPS,
        speed: float = SPEED,
        length: float = LENGTH,
        width: float = WIDTH,
    ) -> None:
        super().__init__(f"random-{scene.seed}", seconds, fps, SIZE)
        self.scene = scene
        self.ground = torch.zeros(3, *SIZE)
        self.light = [torch.from_numpy(bar.light[:: round(FPS / fps)].copy()) for bar in scene.bars]
        bars = [
            Bar(
                b.color,
                direction_degrees(b.direction),
                b.start,
                orientation_degrees(b.orientation),
                speed,
                length,
                width,
            )
            for b in scene.bars
        ]
        self.bars = BarScene(bars, seconds, size=SIZE) if bars else None

    def moments(self, start: int, stop: int) -> Tensor:
        """For how many frames the bars have moved at each frame, `[T]`."""
        return torch.arange(start, stop)

    def frames(self, start: int, stop: int) -> Tensor:
        """Frames number `start` to `stop - 1`, `[T, 3, H, W]` float32 in 0..1."""
        canvas = self.ground.flatten(1).repeat(stop - start, 1, 1)
        if self.bars is not None:
            light = [light[start:stop] for light in self.light]
            self.bars.paint(canvas, self.moments(start, stop).double() / self.fps, light)
        return canvas.view(*canvas.shape[:-1], *self.size)


def by_group(values: Tensor) -> Tensor:
    """Each group of features divided by its own largest, `[..., 10]`; zero where a group has nothing positive."""
    values = values.clamp_min(0)
    return divide(values, spread_groups(group_max(values)))


def present(values: Tensor) -> Tensor:
    """Which features are there, `[..., 10]` bool: at least a third of the largest of their group."""
    return by_group(values) >= PRESENT


def true_features(scenes: Sequence[Scene], first_stage: Tensor) -> list[Tensor]:
    """Features of every bar of every scene, each `[bars, 10]` bool.

    A bar's own fluctuating sums, each group over its largest, go through the settled first stage,
    `(I + W)^-1`; what comes out at a third of its group's largest or more is a feature of the bar.
    """
    bars = [bar for scene in scenes for bar in scene.bars]
    strength = torch.stack([gains(bar) for bar in bars])
    light = torch.from_numpy(np.stack([bar.light for bar in bars]))
    through_motion, direct = moving(light).std(-1, keepdim=True), light.std(-1, keepdim=True)
    own = torch.cat([strength[:, :4] * through_motion, strength[:, 4:] * direct], -1)
    features = present(by_group(own) @ settled(first_stage).T)
    return list(torch.split(features, [len(scene.bars) for scene in scenes]))


@functools.cache
def first_stage() -> Tensor:
    """The trained first-stage weights, `[10, 10]`."""
    weights = ndtorch.load("published").first_stage()
    assert weights is not None
    return weights


def main() -> None:
    """Measure all bars and write the table."""
    torch.set_num_threads(1)
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["direction", "orientation", *FEATURES])
        for direction in range(DIRECTIONS):
            for orientation in range(ORIENTATIONS):
                sums = measure_bar(direction, orientation).tolist()
                writer.writerow([direction, orientation, *(f"{value:.5g}" for value in sums)])
                print(direction, orientation, flush=True)


if __name__ == "__main__":
    main()
