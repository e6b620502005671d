"""Scoring the objects that windows over retinotopic signals find."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ndtorch.binding import ObjectFiles
from ndtorch.binding.object_files import ObjectFileParams, ObjectFileState
from ndtorch.binding.readout.covariances import single_table
from ndtorch.vision import LocalFeatures, VisualFeatures
from ndtorch_train.score.choices import SETTLE, Split
from ndtorch_train.score.leaderboard import Row
from ndtorch_train.score.local_bars import EVERY, FIELDS, SPACING, local_bars, local_sums
from ndtorch_train.score.methods import first_stage
from ndtorch_train.score.metrics import SceneScore, score_scene
from ndtorch_train.score.scenes import FPS, RenderedBars, Restriction, Scene, draw_scene, seeds
from ndtorch_train.score.truth import true_features

NAME = "retinotopic"
BATCH = 50
"""Scenes in memory at once."""


@dataclass(frozen=True)
class LocalSet:
    """A set of scenes.

    Attributes:
        name: for tables.
        restriction: what the bars of a scene have in common.
        bars: numbers of bars, in turn with the seed.
    """

    name: str
    restriction: Restriction
    bars: tuple[int, ...]


SETS = (
    LocalSet("random", Restriction(), (1, 2, 3)),
    LocalSet("four bars", Restriction(), (4,)),
    LocalSet("same color", Restriction(same_color=True), (2, 3)),
    LocalSet("same direction", Restriction(same_direction=True), (2, 3)),
    LocalSet("equal bars", Restriction(same_color=True, same_direction=True), (2, 3)),
)


def drawn(chosen: LocalSet, split: Split, scenes: int) -> list[Scene]:
    """The scenes of a set."""
    r = chosen.restriction
    return [
        draw_scene(seed, Restriction(chosen.bars[seed % len(chosen.bars)], r.same_color, r.same_direction))
        for seed in seeds(split, scenes)
    ]


def found(windows: ObjectFiles, signals: Iterator[Tensor], moments: Sequence[int]) -> list[list[Tensor]]:
    """Features of the objects of every scene, `[objects, 10]` bool, after so many samples."""
    state, taken, readings = None, 0, []
    for chunk in signals:
        for part in torch.split(chunk, 1, 1):
            _, state = windows(part, state)
            taken += 1
            if taken in moments:
                readings.append(features(windows, state))
    return readings


def features(windows: ObjectFiles, state: ObjectFileState) -> list[Tensor]:
    """Features of the objects of every scene of a batch, `[objects, 10]` bool."""
    there = windows.confirmed(state)
    apart = windows.before_light(state)
    rows = single_table(state.covariance, there, first_stage(), apart=apart).rows.sum(-2) > 0
    return [row[seen] for row, seen in zip(rows, there, strict=True)]


def retinotopic_rows(
    split: Split, scenes: int, seconds: Sequence[float], folder: Path, params: ObjectFileParams | None = None
) -> Iterator[Row]:
    """All sets; the random one at every wanted time, the others at the first."""
    table = local_bars(folder)
    windows = ObjectFiles((FIELDS, FIELDS), SPACING, EVERY / FPS, params=params)
    for chosen in SETS:
        times = sorted(seconds) if chosen.name == "random" else [min(seconds)]
        every = drawn(chosen, split, scenes)
        scores: list[list[SceneScore]] = [[] for _ in times]
        for n in range(0, scenes, BATCH):
            part = every[n : n + BATCH]
            truth = true_features(part, first_stage())
            moments = [round((SETTLE + s) * FPS / EVERY) for s in times]
            with torch.inference_mode():
                readings = found(windows, local_sums(part, SETTLE + max(times), table), moments)
            for into, reading in zip(scores, readings, strict=True):
                into += [score_scene(f, t) for f, t in zip(reading, truth, strict=True)]
        for time, judged in zip(times, scores, strict=True):
            yield Row(chosen.name, NAME, True, time, judged)


def rendered_row(split: Split, scenes: int, seconds: float) -> Row:
    """The first random scenes from rendered frames, through the detectors and the fields at 100 frames a second."""
    every = drawn(SETS[0], split, scenes)
    truth = true_features(every, first_stage())
    judged = []
    for scene, true in zip(every, truth, strict=True):
        source = RenderedBars(scene, SETTLE + seconds)
        eyes = LocalFeatures(VisualFeatures(source.size, 1 / source.fps), FIELDS)
        windows = ObjectFiles(eyes.grid, eyes.spacing, 1 / source.fps)
        seen = state = None
        with torch.inference_mode():
            for frames in source.chunks(8):
                signals, seen = eyes(frames, seen)
                _, state = windows(signals.unsqueeze(0), state)
            assert state is not None
            judged.append(score_scene(features(windows, state)[0], true))
    return Row("random, rendered", NAME, True, seconds, judged)
