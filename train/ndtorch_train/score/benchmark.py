"""Running methods over sets of scenes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ndtorch.vision import VisualFeatures
from ndtorch_train.score.bars import bar_sets
from ndtorch_train.score.choices import SETTLE, Split
from ndtorch_train.score.hard import HARD, hard_trial
from ndtorch_train.score.leaderboard import Row
from ndtorch_train.score.methods import Method, Reading, first_stage
from ndtorch_train.score.metrics import SceneScore, right_from, score_scene
from ndtorch_train.score.named import method
from ndtorch_train.score.scenes import FPS, RenderedBars, draw_scene, seeds, superposed
from ndtorch_train.score.stress import SECONDS as STRESS_SECONDS
from ndtorch_train.score.stress import STRESS, stressed
from ndtorch_train.score.truth import true_features

BATCH = 250
"""Scenes in memory at once."""
BAR_SECONDS = {"two bars": (15.0, 36.0, 96.0), "three bars": (15.0, 60.0)}


@dataclass
class Judged:
    """Readings of one method over time, compared with the truth.

    Attributes:
        times: of the readings, seconds from the first frame.
        scores: `scores[i]` are those of all scenes at `times[i]`.
        alternating: share of scenes, at each time.
    """

    times: list[float]
    scores: list[list[SceneScore]]
    alternating: list[list[bool]]

    def add(self, other: Judged) -> None:
        """Take in the scenes of another batch."""
        for mine, theirs in zip(self.scores, other.scores, strict=True):
            mine.extend(theirs)
        for ours, others in zip(self.alternating, other.alternating, strict=True):
            ours.extend(others)


def judge(readings: Sequence[Reading], times: Sequence[float], truth: Sequence[Tensor]) -> Judged:
    """Compare readings with the truth."""
    scores = [[score_scene(found, true) for found, true in zip(r.found, truth, strict=True)] for r in readings]
    return Judged(list(times), scores, [r.alternating.tolist() for r in readings])


def rows_of(judged: Judged, test: str, name: str, online: bool, wanted: Sequence[float]) -> list[Row]:
    """Rows for the wanted seconds after settling; the lasting right count looks at all readings before."""
    rows = []
    for seconds in wanted:
        upto = judged.times.index(SETTLE + seconds) + 1
        since = None
        if upto > 1 and online:
            counts = np.array([[score.found for score in scores] for scores in judged.scores[:upto]])
            bars = [score.bars for score in judged.scores[0]]
            times = np.array(judged.times[:upto])
            each = [right_from(times, counts[:, n], bars[n]) for n in range(len(bars))]
            late = sorted(float("inf") if np.isnan(value) else value for value in each)
            middle = late[(len(late) - 1) // 2]
            since = float("nan") if middle == float("inf") else middle
        alternating = float(np.mean(judged.alternating[upto - 1]))
        rows.append(Row(test, name, online, seconds, judged.scores[upto - 1], alternating, since))
    return rows


def moments(online: bool, seconds: Sequence[float]) -> list[float]:
    """When to read out: every second for methods that look once, only when asked for offline ones."""
    asked = {SETTLE + s for s in seconds}
    if online:
        asked |= {float(n) for n in range(1, int(max(asked)) + 1)}
    return sorted(asked)


def random_rows(name: str, split: Split, scenes: int, seconds: Sequence[float]) -> list[Row]:
    """One method on the random scenes."""
    judged: Judged | None = None
    chosen: Method | None = None
    for part in batches(split, scenes):
        drawn = [draw_scene(seed) for seed in part]
        truth = true_features(drawn, first_stage())
        sums = superposed(drawn, SETTLE + max(seconds))
        chosen = method(name, truth)
        times = moments(chosen.online, seconds)
        new = judge(chosen(sums, FPS, times), times, truth)
        if judged is None:
            judged = new
        else:
            judged.add(new)
    assert judged is not None
    assert chosen is not None
    return rows_of(judged, "random", name, chosen.online, seconds)


def batches(split: Split, scenes: int) -> Iterator[range]:
    """The seeds in batches."""
    every = seeds(split, scenes)
    return (every[n : n + BATCH] for n in range(0, scenes, BATCH))


def stress_rows(names: Sequence[str], split: Split, scenes: int) -> Iterator[Row]:
    """All methods on all stress sets."""
    for stress in STRESS:
        trial = stressed(stress, split, scenes, first_stage())
        for name in names:
            chosen = method(name, trial.truth)
            times = [SETTLE + STRESS_SECONDS]
            judged = judge(chosen(trial.sums, trial.fps, times), times, trial.truth)
            yield from rows_of(judged, stress.name, name, chosen.online, [STRESS_SECONDS])


def hard_rows(names: Sequence[str], split: Split, scenes: int) -> Iterator[Row]:
    """All methods on all hard sets."""
    for hard in HARD:
        trial = hard_trial(hard, split, scenes, first_stage())
        for name in names:
            chosen = method(name, trial.truth)
            times = [SETTLE + hard.seconds]
            judged = judge(chosen(trial.sums, trial.fps, times), times, trial.truth)
            yield from rows_of(judged, hard.name, name, chosen.online, [hard.seconds])


def bar_rows(names: Sequence[str]) -> Iterator[Row]:
    """All methods on the papers' two and three bars at every phase."""
    longest = max(max(seconds) for seconds in BAR_SECONDS.values())
    for bars in bar_sets(SETTLE + longest, first_stage()):
        truth = [bars.truth] * len(bars.settings)
        for name in names:
            chosen = method(name, truth)
            seconds = BAR_SECONDS[bars.name]
            times = [SETTLE + s for s in seconds]
            judged = judge(chosen(bars.sums, FPS, times), times, truth)
            yield from rows_of(judged, bars.name, name, chosen.online, seconds)


def rendered_rows(names: Sequence[str], split: Split, scenes: int, seconds: float) -> Iterator[Row]:
    """All methods on the first few random scenes as rendered frames, beside their superposed sums."""
    drawn = [draw_scene(seed) for seed in seeds(split, scenes)]
    truth = true_features(drawn, first_stage())
    rendered = torch.stack([rendered_sums(RenderedBars(scene, SETTLE + seconds)) for scene in drawn])
    for test, sums in (("rendered", rendered), ("the same superposed", superposed(drawn, SETTLE + seconds))):
        for name in names:
            chosen = method(name, truth)
            times = [SETTLE + seconds]
            yield from rows_of(judge(chosen(sums, FPS, times), times, truth), test, name, chosen.online, [seconds])


def rendered_sums(scene: RenderedBars) -> Tensor:
    """The ten sums of the frames of a scene, `[T, 10]`."""
    features, state, parts = VisualFeatures(scene.size, 1 / scene.fps), None, []
    with torch.inference_mode():
        for frames in scene.chunks(8):
            sums, state = features(frames, state)
            parts.append(sums)
    return torch.cat(parts)
