"""`ndtorch benchmark scenes` and `hard`: methods on sets of scenes of bars."""

from __future__ import annotations

import csv
import functools
import math
import platform
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding.feedback import settled
from ndtorch.errors import InputError
from ndtorch.scenes import Bar, BarScene, SineShadow, three_bars
from ndtorch.scenes.bar_scenes import BLUE, GREEN, PERIOD, RED
from ndtorch.utils.packages import MODELS
from ndtorch.vision import FEATURES, VisualFeatures
from ndtorch_train.benchmark import retinotopic
from ndtorch_train.benchmark.bar_scenes import (
    FPS,
    LONGEST,
    SETTLE,
    SPEED,
    RenderedBars,
    by_group,
    draw_scene,
    first_stage,
    present,
    seeds,
    superposed,
    true_features,
)
from ndtorch_train.benchmark.base import Benchmark, Split, Task, known
from ndtorch_train.benchmark.hard_scenes import HARD, STRESS, STRESS_SECONDS, Trial, hard_trial, stressed
from ndtorch_train.benchmark.scene_scores import COLUMNS, SceneScore, right_from, scene_row, score_scene
from ndtorch_train.benchmark.separation import METHODS
from ndtorch_train.plots import draw_scene_scores
from ndtorch_train.rows import Row

BATCH = 250
"""Scenes in memory at once."""
BAR_SECONDS = {"two bars": (15.0, 36.0, 96.0), "three bars": (15.0, 60.0)}

SETS: Mapping[str, tuple[str, ...]] = {
    "random": ("random",),
    "stress": tuple(one.name for one in STRESS),
    "bars": tuple(BAR_SECONDS),
    "rendered": ("rendered", "the same superposed"),
    "positions": tuple(one.name for one in retinotopic.ALIKE),
    "textured": tuple(one.name for one in retinotopic.RENDERED),
    "hard": tuple(one.name for one in HARD),
}
"""Sets of scenes by group; `positions` and `textured` need a model with receptive fields."""
WITH_FIELDS = ("random", "rendered", "positions", "textured", "hard")
WITHOUT_FIELDS = ("random", "stress", "bars", "rendered", "hard")

USES = ("ndtorch.vision", "ndtorch.scenes", "ndtorch.binding", "ndtorch.loading", MODELS)


def scene_benchmark(
    name: str, methods: Sequence[str], groups: Sequence[str], scenes: int, seconds: Sequence[float], split: Split
) -> Benchmark:
    """The benchmark of some methods on some groups of sets.

    Raises:
        InputError: an unknown method or group, or numbers out of range.
    """
    known("methods", methods, (*METHODS, retinotopic.NAME))
    known("sets", groups, list(SETS))
    if not seconds or not all(0 < s <= LONGEST - SETTLE for s in seconds):
        raise InputError(f"seconds must lie between 0 and {LONGEST - SETTLE:g}, got {tuple(seconds)}")
    first, wanted = seeds(split, scenes).start, tuple(sorted(seconds))
    tasks = [
        Task(f"{one}, {method}", functools.partial(measure, group, one, method, split, scenes, wanted))
        for group in groups
        for one in SETS[group]
        for method in methods
        if group in (WITH_FIELDS if method == retinotopic.NAME else WITHOUT_FIELDS)
        and not (method == retinotopic.NAME and one == "the same superposed")
    ]
    if not tasks:
        raise InputError(f"no method of {', '.join(methods)} takes the sets {', '.join(groups)}")
    note = (
        f"Split {split}: seeds from {first} on, {scenes} scenes a set. Ratios ± their standard errors over scenes. "
        "count: the right number of objects; F1: agreement of the features of the objects with the truth; ok: number "
        f"and features are right. Seconds count after {SETTLE:g} s of settling, those of 'right from' from the first "
        f"frame. One core, {platform.machine()}, torch {torch.__version__}."
    )
    title = "Hard scenes" if name == "hard" else "Binding on random scenes"
    settings = {"split": split, "scenes": scenes, "seconds": wanted}
    pivot = ("count", "ok") if name == "hard" else ()
    return Benchmark(name, title, note, COLUMNS, tasks, USES, draw=draw_scene_scores, pivot=pivot, settings=settings)


def measure(
    group: str, name: str, method: str, split: Split, scenes: int, seconds: Sequence[float], folder: Path
) -> list[Row]:
    """Rows of one method on one set."""
    if method == retinotopic.NAME:
        return retinotopic.measure(group, name, split, scenes, seconds, folder)
    times: list[float] = []
    wanted: Sequence[float] = ()
    scores: list[list[SceneScore]] = []
    alternating: list[list[bool]] = []
    online = False
    for trial, wanted in trials(group, name, split, scenes, seconds):
        chosen = METHODS[method](trial.truth)
        online = chosen.online
        times = moments(wanted, online and group == "random")
        for n, reading in enumerate(chosen(trial.sums, trial.fps, times)):
            if len(scores) <= n:
                scores.append([])
                alternating.append([])
            scores[n] += [score_scene(f, t) for f, t in zip(reading.found, trial.truth, strict=True)]
            alternating[n] += reading.alternating.tolist()
    rows = []
    for s in wanted:
        n = times.index(SETTLE + s)
        since = lasting(times[: n + 1], scores[: n + 1]) if n and online else None
        rows.append(scene_row(name, method, online, s, scores[n], float(np.mean(alternating[n])), since))
    return rows


def moments(seconds: Sequence[float], every_second: bool) -> list[float]:
    """When to read out, seconds from the first frame."""
    asked = {SETTLE + s for s in seconds}
    if every_second:
        asked |= {float(n) for n in range(1, int(max(asked)) + 1)}
    return sorted(asked)


def lasting(times: Sequence[float], scores: Sequence[Sequence[SceneScore]]) -> float:
    """Median over scenes of the time from which on the count was right; scores by time and scene."""
    counts = np.array([[score.found for score in at] for at in scores])
    each = sorted(right_from(np.array(times), counts[:, n], score.bars) for n, score in enumerate(scores[0]))
    return each[(len(each) - 1) // 2]


def trials(
    group: str, name: str, split: Split, scenes: int, seconds: Sequence[float]
) -> Iterator[tuple[Trial, Sequence[float]]]:
    """Scenes of a set in batches, and the seconds at which they are scored."""
    if group == "random":
        every = seeds(split, scenes)
        for n in range(0, scenes, BATCH):
            drawn = [draw_scene(seed) for seed in every[n : n + BATCH]]
            yield Trial(superposed(drawn, SETTLE + max(seconds)), FPS, true_features(drawn, first_stage())), seconds
    elif group == "stress":
        (stress,) = (one for one in STRESS if one.name == name)
        yield stressed(stress, split, scenes), [STRESS_SECONDS]
    elif group == "hard":
        (hard,) = (one for one in HARD if one.name == name)
        yield hard_trial(hard, split, scenes), [hard.seconds]
    elif group == "bars":
        yield paper_bars(name, SETTLE + max(BAR_SECONDS[name])), BAR_SECONDS[name]
    else:
        drawn, end = [draw_scene(seed) for seed in seeds(split, scenes)], SETTLE + min(seconds)
        sums = (
            torch.stack([rendered_sums(RenderedBars(scene, end)) for scene in drawn])
            if name == "rendered"
            else superposed(drawn, end)
        )
        yield Trial(sums, FPS, true_features(drawn, first_stage())), [min(seconds)]


def rendered_sums(scene: RenderedBars | BarScene) -> Tensor:
    """The ten sums of the frames of a scene, `[T, 10]`."""
    features, state, parts = VisualFeatures(scene.size, 1 / scene.fps), None, []
    with torch.inference_mode():
        for frames in scene.chunks(8):
            sums, state = features(frames, state)
            parts.append(sums)
    return torch.cat(parts)


# The papers' two and three bars at every phase of their shadow, as superposed sums. [B §3.4.1-3.4.2]

PHASES = tuple(range(0, 360, 20))
BLUE_OFFSETS = (0.0, 10.0, 20.0, 30.0, 40.0)
HARMONICS = 4
BARS = {"red": (RED, -30.0), "green": (GREEN, 210.0), "blue": (BLUE, 180.0)}
CYCLES = Path(__file__).with_name("cycles.csv")
CANVAS = 350
RENDERED_SECONDS = 4.0
"""Seconds of every single bar that are rendered; the motion filters settle in the first half."""


def single_bar_cycles() -> dict[str, Tensor]:
    """The measured coefficients of all three bars, see `measure_cycle`."""
    cycles = {name: torch.zeros(2 * HARMONICS + 1, 10, dtype=torch.float64) for name in BARS}
    with CYCLES.open(encoding="utf-8") as file:
        for name, term, *sums in list(csv.reader(file))[1:]:
            cycles[name][int(term)] = torch.tensor([float(value) for value in sums], dtype=torch.float64)
    return cycles


def measure_cycle(name: str) -> Tensor:
    """Fourier coefficients of the ten sums of one bar of `three_bars` alone, `[2 * HARMONICS + 1, 10]`.

    The sums depend on time only through the bar's phase in the shadow, `sin(phase)` being its light. The coefficients
    of `fourier_basis(phase)` come from rendered frames by least squares.
    """
    color, direction = BARS[name]
    # A width of a whole number of shadow periods, so that the shadow closes at the edges.
    start = (CANVAS / 2, CANVAS / 2)
    bar = Bar(color, direction, start)
    sums = rendered_sums(BarScene([bar], RENDERED_SECONDS, SineShadow(PERIOD), (CANVAS, CANVAS), FPS)).double()
    times = torch.arange(len(sums), dtype=torch.float64) / FPS
    phase = 2 * math.pi * (start[0] + SPEED * math.cos(math.radians(direction)) * times) / PERIOD
    half = len(sums) // 2
    coefficients: Tensor = torch.linalg.lstsq(fourier_basis(phase[half:]), sums[half:]).solution
    return coefficients


def fourier_basis(phase: Tensor) -> Tensor:
    """1, sin and cos of the phase and its multiples, `[..., 2 * HARMONICS + 1]`."""
    multiples = phase.unsqueeze(-1) * torch.arange(1, HARMONICS + 1, dtype=phase.dtype)
    return torch.cat([torch.ones_like(phase).unsqueeze(-1), multiples.sin(), multiples.cos()], -1)


def paper_bars(name: str, seconds: float) -> Trial:
    """Two bars at 18 phases, or three bars at 90 combinations of phase and offset of the blue one."""
    cycles = single_bar_cycles()
    own = torch.stack([c[1:].square().sum(0).sqrt() for c in cycles.values()])
    truth = present(by_group(own.float()) @ settled(first_stage()).T)
    bars = 2 if name == "two bars" else 3
    settings = [(float(phase), offset) for phase in PHASES for offset in (BLUE_OFFSETS if bars == 3 else (0.0,))]
    times = torch.arange(round(seconds * FPS), dtype=torch.float64) / FPS
    total = []
    for lead, offset in settings:
        # The same starts as `three_bars` in a 500 x 500 image.
        places = three_bars(1.0, phase=lead, blue_offset=offset).bars
        sums = torch.zeros(len(times), 10, dtype=torch.float64)
        for color, bar in zip(BARS, places[:bars], strict=False):
            assert isinstance(bar, Bar)
            column = bar.start[0] + bar.speed * math.cos(math.radians(bar.direction)) * times
            sums += fourier_basis(2 * math.pi * column / PERIOD) @ cycles[color]
        total.append(sums.float())
    return Trial(torch.stack(total), FPS, [truth[:bars]] * len(settings))


def main() -> None:
    """Measure the three bars and write `cycles.csv`."""
    torch.set_num_threads(1)
    with CYCLES.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["bar", "term", *FEATURES])
        for name in BARS:
            for term, sums in enumerate(measure_cycle(name).tolist()):
                writer.writerow([name, term, *(f"{value:.5g}" for value in sums)])


if __name__ == "__main__":
    main()
