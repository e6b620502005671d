"""`ndtorch benchmark scenes` and `hard`: methods on sets of scenes of bars."""

from __future__ import annotations

import functools
import platform
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from ndtorch.binding.learning import settled
from ndtorch.errors import InputError
from ndtorch.utils.packages import MODELS
from ndtorch_train.benchmark import retinotopic
from ndtorch_train.benchmark.bar_scenes import (
    ALIKE,
    FPS,
    LONGEST,
    SETTLE,
    RenderedBars,
    by_group,
    draw_scene,
    first_stage,
    present,
    scenes_of,
    seeds,
    superposed,
    true_features,
)
from ndtorch_train.benchmark.base import Benchmark, Split, Task, known
from ndtorch_train.benchmark.hard_scenes import HARD, Trial, hard_trial
from ndtorch_train.benchmark.scene_scores import COLUMNS, SceneScore, right_from, scene_row, score_scene
from ndtorch_train.benchmark.separation import METHODS
from ndtorch_train.plots import draw_scene_scores
from ndtorch_train.rows import Row
from ndtorch_train.superposed import Stimuli, film_bars, rendered_sums

BATCH = 250
"""Scenes in memory at once."""
PHASES = tuple(float(phase) for phase in range(0, 360, 20))
BLUE_OFFSETS = (0.0, 10.0, 20.0, 30.0, 40.0)
BAR_SECONDS = {"two bars": (15.0, 36.0, 96.0), "three bars": (15.0, 60.0)}

SETS: Mapping[str, tuple[str, ...]] = {
    "random": ("random",),
    "alike": tuple(one.name for one in ALIKE),
    "bars": tuple(BAR_SECONDS),
    "rendered": ("rendered", "the same superposed"),
    "textured": tuple(one.name for one in retinotopic.RENDERED),
    "hard": tuple(one.name for one in HARD),
}
"""Sets of scenes by group; `textured` needs a model with receptive fields."""
WITH_FIELDS = ("random", "alike", "rendered", "textured", "hard")
WITHOUT_FIELDS = ("random", "alike", "bars", "rendered", "hard")

USES = ("ndtorch.vision", "ndtorch.scenes", "ndtorch.binding", "ndtorch.loading", MODELS)


def scene_benchmark(
    name: str, methods: Sequence[str], groups: Sequence[str], scenes: int, seconds: Sequence[float], split: Split
) -> Benchmark:
    """The benchmark of some methods on some groups of sets."""
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
    elif group == "alike":
        (chosen,) = (one for one in ALIKE if one.name == name)
        drawn = scenes_of(chosen, split, scenes)
        sums = superposed(drawn, SETTLE + min(seconds))
        yield Trial(sums, FPS, true_features(drawn, first_stage())), [min(seconds)]
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


def paper_bars(name: str, seconds: float) -> Trial:
    """The papers' bars: two at 18 phases, or three at 90 combinations of phase and start of the blue one. [B §3.4.1]"""
    bars = Stimuli(film_bars())
    red, green = bars.red(seconds), bars.green(PHASES, seconds)
    sums, own = red + green, [red, green[0]]
    if name == "three bars":
        blue = bars.blue(BLUE_OFFSETS, seconds)
        sums, own = (sums[:, None] + blue).flatten(0, 1), [*own, blue[0]]
    strength = torch.stack([one.std(0) for one in own])
    truth = present(by_group(strength) @ settled(first_stage()).T)
    return Trial(sums, FPS, [truth] * len(sums))
