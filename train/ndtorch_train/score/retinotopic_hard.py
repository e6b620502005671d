"""The hard random scenes as fields see them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ndtorch.binding import ObjectFiles
from ndtorch.binding.object_files import ObjectFileParams
from ndtorch_train.score.choices import SETTLE, Split
from ndtorch_train.score.hard import HARD, HardSet, arrived, hard_scenes, no_bars, smoothed
from ndtorch_train.score.leaderboard import Row
from ndtorch_train.score.local_bars import EVERY, FIELDS, SPACING, local_bars, local_sums
from ndtorch_train.score.methods import first_stage
from ndtorch_train.score.metrics import score_scene
from ndtorch_train.score.retinotopic import NAME, features
from ndtorch_train.score.scenes import FPS
from ndtorch_train.score.stress import group_largest
from ndtorch_train.score.truth import true_features

BATCH = 10
"""Scenes in memory at once."""


def hard_retinotopic_rows(
    split: Split, scenes: int, folder: Path, sets: tuple[HardSet, ...] = HARD, params: ObjectFileParams | None = None
) -> Iterator[Row]:
    """All hard sets, a row each."""
    table = local_bars(folder)
    for hard in sets:
        every = every_of(hard)
        windows = ObjectFiles((FIELDS, FIELDS), SPACING, every / FPS, params=params)
        chosen, scores = hard_scenes(hard, split, scenes), []
        for n in range(0, scenes, BATCH):
            part = chosen[n : n + BATCH]
            with torch.inference_mode():
                chunks = local_sums([one.scene for one in part], SETTLE + hard.seconds, table, every=every)
                signals = torch.cat(list(chunks), 1)
                seeds = [one.scene.seed for one in part]
                for seed, mine in zip(seeds, signals, strict=True):
                    mine += local_disturbance(hard, seed, mine)
                kept = arrived(hard, seeds, signals.shape[1] * every, every)
                seen = torch.stack([mine[at // every] for mine, at in zip(signals, kept, strict=True)])
                _, state = windows(seen)
            # A bar that moves is an object to fields, whether it fluctuates or not.
            shown = [one.scene if hard.steady else one.shown for one in part]
            truth = [true_features([one], first_stage())[0] if one.bars else no_bars() for one in shown]
            scores += [score_scene(f, t) for f, t in zip(features(windows, state), truth, strict=True)]
        yield Row(hard.name, NAME, True, hard.seconds, scores)


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
