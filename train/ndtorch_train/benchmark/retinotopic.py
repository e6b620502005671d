"""Scenes of bars with their positions: the signals of a grid of fields, and the objects that files find in them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding import ObjectFiles
from ndtorch.binding.learning import settled
from ndtorch.binding.object_files import ObjectFileParams, ObjectFileState
from ndtorch.binding.readout.covariances import single_table
from ndtorch.scenes import Bar, BarScene, FrameSource
from ndtorch.utils.files import hold, replacing
from ndtorch.vision import GROUPS, LocalFeatures, VisualFeatures
from ndtorch_train.benchmark.bar_scenes import (
    ALIKE,
    DIRECTIONS,
    FPS,
    LENGTH,
    ORIENTATIONS,
    RANDOM,
    SETTLE,
    SIZE,
    SPEED,
    WIDTH,
    RenderedBars,
    Restriction,
    Scene,
    SceneSet,
    by_group,
    direction_degrees,
    draw_scene,
    first_stage,
    gains,
    moving,
    orientation_degrees,
    present,
    scenes_of,
    seeds,
    true_features,
)
from ndtorch_train.benchmark.base import Split
from ndtorch_train.benchmark.hard_scenes import HARD, HardSet, arrived, group_largest, hard_scenes, no_bars, smoothed
from ndtorch_train.benchmark.scene_scores import SceneScore, scene_row, score_scene
from ndtorch_train.rows import Row

NAME = "retinotopic"
BATCH, HARD_BATCH = 50, 10
"""Scenes in memory at once."""
FIELDS = 16
SPACING = SIZE[0] / FIELDS
CANVAS = 350
"""Side of the torus on which single bars are drawn; a bar is not felt further away than half of it."""
STEP = 5
"""Pixels between the offsets at which responses are kept; files are wider than 60."""
POINTS = CANVAS // STEP
FRAMES = 150
EVERY = 5
"""Samples of 10 ms from one kept to the next: files are updated as often."""


def measure_field(direction: int, orientation: int, features: VisualFeatures) -> Tensor:
    """What a field sees of a white bar at every offset from its center, `[8, POINTS, POINTS]`.

    Four motions, three orientations, and the bar's area. Rows and columns of offsets run from 0 to the canvas.
    """
    heading, end = math.radians(direction_degrees(direction)), (FRAMES - 1) / FPS
    start = (CANVAS / 2 - SPEED * math.cos(heading) * end, CANVAS / 2 + SPEED * math.sin(heading) * end)
    bar = Bar(
        (1.0, 1.0, 1.0), direction_degrees(direction), start, orientation_degrees(orientation), SPEED, LENGTH, WIDTH
    )
    scene, state = BarScene([bar], FRAMES / FPS, size=(CANVAS, CANVAS)), None
    for frames in scene.chunks(10):
        _, _, state = features.motion.scan(frames.mean(-3), state)
    assert state is not None
    images = features.images_at(frames[-1], state)[:8].roll((-CANVAS // 2, -CANVAS // 2), (-2, -1))
    # One field of the real width, centered on pixel 0.
    places = (torch.arange(CANVAS) + CANVAS / 2) % CANVAS - CANVAS / 2
    line = torch.where(places.abs() < SPACING, 0.5 + 0.5 * torch.cos(math.pi * places / SPACING), torch.zeros(()))
    window = torch.fft.rfft2(line[:, None] * line)
    seen: Tensor = torch.fft.irfft2(window * torch.fft.rfft2(images).conj(), s=(CANVAS, CANVAS))
    return seen[:, ::STEP, ::STEP].clamp_min(0)


def local_bars(folder: Path) -> Tensor:
    """Responses to all bars, `[DIRECTIONS, ORIENTATIONS, 8, POINTS, POINTS]`; measured once and kept in `folder`."""
    file = folder / f"local_bars_{FIELDS}_{CANVAS}_{STEP}.npy"
    with file.with_suffix(".lock").open("w") as lock:
        hold(lock, lambda: None)
        if file.is_file():
            return torch.from_numpy(np.load(file).astype(np.float32))
        table = torch.zeros(DIRECTIONS, ORIENTATIONS, 8, POINTS, POINTS)
        features = VisualFeatures((CANVAS, CANVAS))
        with torch.inference_mode():
            for direction, orientation in np.ndindex(DIRECTIONS, ORIENTATIONS):
                table[direction, orientation] = measure_field(direction, orientation, features)
        with replacing(file) as beside:
            np.save(beside, table.numpy())
    return table


def local_sums(
    scenes: Sequence[Scene], seconds: float, table: Tensor, chunk: int = 20, every: int = EVERY
) -> Iterator[Tensor]:
    """Signals of all fields, `[B, T, FIELDS, FIELDS, 10]` in chunks of T, a sample every `every` frames.

    Single bars are superposed, which leaves out nothing but that bars cover each other where they cross.
    """
    steps = torch.arange(0, round(seconds * FPS), every)
    for part in torch.split(steps, chunk):
        yield torch.stack([scene_sums(scene, part, table) for scene in scenes])


def scene_sums(scene: Scene, steps: Tensor, table: Tensor) -> Tensor:
    """Signals of one scene at those frame numbers, `[T, FIELDS, FIELDS, 10]`."""
    centers = (torch.arange(FIELDS) + 0.5) * SPACING - 0.5
    total = torch.zeros(len(steps), FIELDS, FIELDS, 10)
    for bar in scene.bars:
        heading = math.radians(direction_degrees(bar.direction))
        seconds = steps / FPS
        columns = bar.start[0] + SPEED * math.cos(heading) * seconds
        rows = bar.start[1] - SPEED * math.sin(heading) * seconds
        seen = at_offsets(table[bar.direction, bar.orientation], rows, columns, centers)
        light = torch.from_numpy(bar.light)
        color = torch.tensor(bar.color)
        grey, twice = color.mean(), moving(light)[steps][:, None, None, None]
        light = light[steps][:, None, None, None]
        for group, gain in zip(GROUPS.values(), (twice * grey**2, light * grey, light * color), strict=True):
            total[..., group] += seen[..., group] * gain
    return total


def at_offsets(responses: Tensor, rows: Tensor, columns: Tensor, centers: Tensor) -> Tensor:
    """Responses `[8, POINTS, POINTS]` at the offsets of a bar from every field, `[T, FIELDS, FIELDS, 8]`."""
    line = responses.permute(1, 2, 0).reshape(-1, responses.shape[0])
    places = []
    for at, length in ((rows, SIZE[0]), (columns, SIZE[1])):
        away = (at[:, None] - centers + length / 2) % length - length / 2
        # Beyond half the canvas nothing is felt.
        within = away.abs() < CANVAS / 2 - STEP
        grid = torch.where(within, away, CANVAS / 2) % CANVAS / STEP
        low = grid.floor()
        share = grid - low
        low = low.long()
        places.append([(low % POINTS, (1 - share) * within), ((low + 1) % POINTS, share * within)])
    total = torch.zeros(len(rows), len(centers), len(centers), responses.shape[0])
    for row, row_share in places[0]:
        for column, column_share in places[1]:
            index = row[:, :, None] * POINTS + column[:, None, :]
            total += line[index] * (row_share[:, :, None] * column_share[:, None, :]).unsqueeze(-1)
    return total


def found(files: ObjectFiles, signals: Iterator[Tensor], moments: Sequence[int]) -> list[list[Tensor]]:
    """Features of the objects of every scene, `[objects, 10]` bool, after so many samples."""
    state, taken, readings = None, 0, []
    for chunk in signals:
        for part in torch.split(chunk, 1, 1):
            _, state = files(part, state)
            taken += 1
            if taken in moments:
                readings.append(features(files, state))
    return readings


def features(files: ObjectFiles, state: ObjectFileState) -> list[Tensor]:
    """Features of the objects of every scene of a batch, `[objects, 10]` bool."""
    there = files.confirmed(state)
    apart = files.before_light(state)
    rows = single_table(state.covariance, there, first_stage(), apart=apart).rows.sum(-2) > 0
    return [row[seen] for row, seen in zip(rows, there, strict=True)]


RENDERED_SECONDS, RATE = 8.0, 50.0
"""Of a scene, and its frames a second."""

RENDERED_SEED = 20_000_000
"""Of these sets: no other set has seeds from here on."""


@dataclass(frozen=True)
class LocalScenes:
    """A set of scenes.

    Attributes:
        name: for tables.
        texture: the ground is textured, else black.
        steady: the bars' brightness stays .6.
        speed: pixels a second.
        length, width: of the bars, pixels.
        cross: width in pixels of the arms of a grey cross in front of them; 0: none.
        stop_s: seconds for which the bars are stationary after every 1.5 s of motion.
    """

    name: str
    texture: bool = False
    steady: bool = False
    speed: float = SPEED
    length: float = LENGTH
    width: float = WIDTH
    cross: int = 0
    stop_s: float = 0.0


RENDERED = (
    LocalScenes("textured ground", texture=True),
    LocalScenes("steady brightness", steady=True),
    LocalScenes("200 px/s", speed=200.0),
    LocalScenes("bars of 90 x 25", length=90.0, width=25.0),
    LocalScenes("behind an occluder", cross=60),
    LocalScenes("stop-and-go", stop_s=0.5),
)
GOES = 1.5
"""Seconds of motion between stops."""


def ground(seed: int, size: tuple[int, int] = SIZE) -> Tensor:
    """Smooth noise of .1 to .5, mostly grey, `[3, H, W]`; it goes on around the torus."""
    generator = torch.Generator().manual_seed(seed)
    grey, color = (torch.rand(1, n, *size, generator=generator) for n in (1, 3))
    around = torch.nn.functional.pad(0.7 * grey + 0.3 * color, (4, 4, 4, 4), mode="circular")
    smooth = torch.nn.functional.avg_pool2d(around, 9, 1)[0]
    return 0.1 + 0.4 * (smooth - smooth.amin()) / (smooth.amax() - smooth.amin())


class OnGround(RenderedBars):
    """The bars of a random scene over a ground, later ones over earlier ones."""

    def __init__(self, scene: Scene, kind: LocalScenes, seconds: float = RENDERED_SECONDS) -> None:
        super().__init__(scene, seconds, RATE, kind.speed, kind.length, kind.width)
        self.kind = kind
        if kind.texture:
            self.ground = ground(scene.seed)
        if kind.steady:
            self.light = [torch.full_like(light, 0.6) for light in self.light]

    def moments(self, start: int, stop: int) -> Tensor:
        """For how many frames the bars have moved at each frame, `[T]`."""
        return moved(torch.arange(start, stop), self.kind.stop_s)

    def frames(self, start: int, stop: int) -> Tensor:
        """Frames `start` to `stop - 1`, `[T, 3, H, W]` float32 in 0..1."""
        canvas = super().frames(start, stop)
        if self.kind.cross:
            canvas = canvas.clone()
            for side in (-1, -2):
                middle = self.size[side] // 2
                canvas.narrow(side, middle - self.kind.cross // 2, self.kind.cross).fill_(0.3)
        return canvas


def moved(frames: Tensor, stop_s: float) -> Tensor:
    """Frames of motion up to each frame `[T]` of a bar that moves `GOES` s and stops `stop_s` s in turn."""
    goes, both = round(GOES * RATE), round((GOES + stop_s) * RATE)
    return frames // both * goes + (frames % both).clamp_max(goes)


def truth_of(scene: Scene, kind: LocalScenes) -> Tensor:
    """Features of the bars, `[bars, 10]` bool: of what fluctuates, or of what is there where nothing does."""
    if not kind.steady:
        return true_features([scene], first_stage())[0]
    own = by_group(torch.stack([gains(bar) for bar in scene.bars]))
    return present(own @ settled(first_stage()).T)


def seen_in(source: FrameSource, params: ObjectFileParams | None = None, chunk: int = 10) -> Tensor:
    """Features of the objects at the end of rendered frames, `[objects, 10]` bool."""
    fields = LocalFeatures(VisualFeatures(source.size, 1 / source.fps), FIELDS)
    files = ObjectFiles(fields.grid, fields.spacing, 1 / source.fps, params=params)
    seen = state = None
    with torch.inference_mode():
        for frames in source.chunks(chunk):
            signals, seen = fields(frames, seen)
            _, state = files(signals.unsqueeze(0), state)
    assert state is not None
    return features(files, state)[0]


def measure(group: str, name: str, split: Split, scenes: int, seconds: Sequence[float], folder: Path) -> list[Row]:
    """Rows of one set of the group `random`, `alike`, `hard`, `rendered` or `textured`."""
    if group == "hard":
        (hard,) = (one for one in HARD if one.name == name)
        return [scene_row(name, NAME, True, hard.seconds, hard_scores(hard, split, scenes, local_bars(folder)))]
    if group == "textured":
        (kind,) = (one for one in RENDERED if one.name == name)
        return [scene_row(name, NAME, True, RENDERED_SECONDS, textured_scores(kind, split, scenes))]
    if group == "rendered":
        every, end = scenes_of(RANDOM, split, scenes), min(seconds)
        seen = [seen_in(RenderedBars(scene, SETTLE + end), chunk=8) for scene in every]
        truth = true_features(every, first_stage())
        return [scene_row(name, NAME, True, end, [score_scene(f, t) for f, t in zip(seen, truth, strict=True)])]
    (chosen,) = (one for one in (RANDOM, *ALIKE) if one.name == name)
    times = sorted(seconds) if chosen is RANDOM else [min(seconds)]
    scores = random_scores(chosen, split, scenes, times, local_bars(folder))
    return [scene_row(name, NAME, True, time, judged) for time, judged in zip(times, scores, strict=True)]


def random_scores(
    chosen: SceneSet, split: Split, scenes: int, times: Sequence[float], table: Tensor
) -> list[list[SceneScore]]:
    """Scores of superposed scenes, by time and scene."""
    files = ObjectFiles((FIELDS, FIELDS), SPACING, EVERY / FPS)
    every = scenes_of(chosen, split, scenes)
    scores: list[list[SceneScore]] = [[] for _ in times]
    for n in range(0, scenes, BATCH):
        part = every[n : n + BATCH]
        truth = true_features(part, first_stage())
        moments = [round((SETTLE + s) * FPS / EVERY) for s in times]
        with torch.inference_mode():
            readings = found(files, local_sums(part, SETTLE + max(times), table), moments)
        for into, reading in zip(scores, readings, strict=True):
            into += [score_scene(f, t) for f, t in zip(reading, truth, strict=True)]
    return scores


def hard_scores(hard: HardSet, split: Split, scenes: int, table: Tensor) -> list[SceneScore]:
    """Scores of a hard set."""
    every = every_of(hard)
    files = ObjectFiles((FIELDS, FIELDS), SPACING, every / FPS)
    chosen, scores = hard_scenes(hard, split, scenes), list[SceneScore]()
    for n in range(0, scenes, HARD_BATCH):
        part = chosen[n : n + HARD_BATCH]
        with torch.inference_mode():
            chunks = local_sums([one.scene for one in part], SETTLE + hard.seconds, table, every=every)
            signals = torch.cat(list(chunks), 1)
            numbers = [one.scene.seed for one in part]
            for seed, mine in zip(numbers, signals, strict=True):
                mine += local_disturbance(hard, seed, mine)
            kept = arrived(hard, numbers, signals.shape[1] * every, every)
            seen = torch.stack([mine[at // every] for mine, at in zip(signals, kept, strict=True)])
            _, state = files(seen)
        # A bar that moves is an object to fields, whether it fluctuates or not.
        shown = [one.scene if hard.steady else one.shown for one in part]
        truth = [true_features([one], first_stage())[0] if one.bars else no_bars() for one in shown]
        scores += [score_scene(f, t) for f, t in zip(features(files, state), truth, strict=True)]
    return scores


def textured_scores(kind: LocalScenes, split: Split, scenes: int) -> list[SceneScore]:
    """Scores of rendered scenes that superposed ones cannot show: one to three bars in turn."""
    scores = []
    for seed in (RENDERED_SEED + n for n in seeds(split, scenes)):
        scene = draw_scene(seed, Restriction(seed % 3 + 1))
        scores.append(score_scene(seen_in(OnGround(scene, kind)), truth_of(scene, kind)))
    return scores


def local_disturbance(hard: HardSet, seed: int, signals: Tensor) -> Tensor:
    """What comes to the signals `[T, R, C, 10]` of all fields beside the bars.

    The unit is the deviation of each group's strongest field: noise is each field's own, a lamp shines on all alike.
    """
    level = group_largest(signals.std(0).amax((0, 1)))
    rng, (samples, rows, columns, _) = np.random.default_rng(seed + 500_000_000), signals.shape
    total = torch.zeros_like(signals)
    if hard.white:
        total += hard.white * torch.from_numpy(rng.standard_normal(tuple(signals.shape)).astype(np.float32))
    if hard.smooth:
        flat = smoothed(rng, rng.uniform(0.1, 0.3) / every_of(hard), samples, rows * columns * 10)
        total += hard.smooth * torch.from_numpy(flat).reshape(samples, rows, columns, 10)
    if hard.lamp:
        shine = smoothed(rng, rng.uniform(0.08, 0.3) / every_of(hard), samples)[:, 0]
        total[..., 4:] += hard.lamp * torch.from_numpy(shine)[:, None, None, None]
    return level * total


def every_of(hard: HardSet) -> int:
    """Samples of 10 ms between those of the fields."""
    return hard.every if hard.every > 1 else EVERY
