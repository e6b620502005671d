"""How well patches of moving dots are found: their number, their places, their outlines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from ndtorch.errors import InputError
from ndtorch.nearest import meant
from ndtorch.scenes import CommonFate
from ndtorch_train.score.choices import Split
from ndtorch_train.score.fate.methods import METHODS, Found

FIRST_SEED = {"tune": 20_000_000, "test": 21_000_000}
"""Scene i of condition k has this seed plus 10 000 k + i."""
SECONDS = 3.0
AGO = (0.8, 0.4, 0.0)
"""Seconds before the end at which a scene is scored."""


@dataclass(frozen=True)
class Condition:
    """What is asked of a set of scenes: one parameter of `CommonFate` that differs from the others."""

    name: str
    value: float
    options: Mapping[str, Any] = field(default_factory=dict)


def conditions() -> list[Condition]:
    """Coherence, density, lifetime, the ground's coherence and the number of patches in turn, the rest as it comes."""
    found = [Condition("coherence", v, {"coherence": v}) for v in (1.0, 0.75, 0.5, 0.35, 0.25, 0.15)]
    found += [Condition("density", v, {"density": v}) for v in (0.005, 0.01, 0.04)]
    found += [Condition("lifetime", v, {"lifetime": v}) for v in (0.12, 0.2, 0.8, math.inf)]
    found += [Condition("ground", v, {"ground": v}) for v in (0.5, 1.0)]
    found += [Condition("patches", v, {"patches": v}) for v in (0, 2, 3)]
    return found


@dataclass(frozen=True)
class FateScore:
    """One scene, over the moments at which it was looked at.

    Attributes:
        count: share of moments with the right number.
        place: F of places: each patch holds one, each place lies in one.
        iou: mean over patches of the intersection over the union with the thing that fits best; None without masks.
    """

    count: float
    place: float
    iou: float | None


def scored(found: Sequence[Found], truth: npt.NDArray[np.bool_]) -> tuple[bool, float, float | None]:
    """Count, F of places and mean IoU of what was found, against masks `[patches, H, W]`."""
    right = len(found) == len(truth)
    if not len(truth):
        return right, float(right), None
    hits = np.zeros((len(truth), len(found)))
    overlap = np.zeros((len(truth), len(found)))
    for k, one in enumerate(found):
        column, row = (round(part) for part in one.place)
        within = 0 <= row < truth.shape[1] and 0 <= column < truth.shape[2]
        for n, mask in enumerate(truth):
            hits[n, k] = within and mask[row, column]
            if one.mask is not None:
                overlap[n, k] = (mask & one.mask).sum() / max(1, (mask | one.mask).sum())
    pairs = linear_sum_assignment(hits, maximize=True)
    place = 2 * hits[pairs].sum() / (len(truth) + len(found))
    masks = any(one.mask is not None for one in found) or not found
    best = overlap[linear_sum_assignment(overlap, maximize=True)].sum() / len(truth)
    return right, float(place), float(best) if masks else None


def score_scene(method: str, scene: CommonFate) -> FateScore:
    """One method on one scene."""
    moments = [scene.length - 1 - round(ago * scene.fps) for ago in AGO]
    readings = METHODS[method]()(scene, moments)
    scores = [scored(f, scene.masks(m, m + 1)[0].numpy()) for f, m in zip(readings, moments, strict=True)]
    counts, places, overlaps = zip(*scores, strict=True)
    ious = [one for one in overlaps if one is not None]
    return FateScore(float(np.mean(counts)), float(np.mean(places)), float(np.mean(ious)) if ious else None)


@dataclass(frozen=True)
class FateRow:
    """One method under one condition, a score a scene."""

    condition: Condition
    method: str
    scores: Sequence[FateScore]

    def mean(self, what: str) -> float:
        """Mean of "count", "place" or "iou" over the scenes, NaN where no scene has it."""
        values = [v for score in self.scores if (v := getattr(score, what)) is not None]
        return float(np.mean(values)) if values else float("nan")

    def error(self, what: str) -> float:
        """Its standard error."""
        values = [v for score in self.scores if (v := getattr(score, what)) is not None]
        return float(np.std(values) / math.sqrt(len(values))) if values else float("nan")


def fate_rows(
    methods: Sequence[str], split: Split, scenes: int, wanted: Sequence[Condition], told: Callable[[str], None]
) -> Iterator[FateRow]:
    """All methods on `scenes` scenes of every condition."""
    every = [(one.name, one.value) for one in conditions()]
    for condition in wanted:
        first = FIRST_SEED[split] + 10_000 * every.index((condition.name, condition.value))
        for method in methods:
            scores = [
                score_scene(method, CommonFate(SECONDS, seed=first + n, **condition.options)) for n in range(scenes)
            ]
            row = FateRow(condition, method, scores)
            told(f"{condition.name} {condition.value:g}, {method}: count {row.mean('count'):.2f}")
            yield row


def wanted_conditions(names: Sequence[str]) -> list[Condition]:
    """The conditions of those names; all of them without names.

    Raises:
        InputError: one that is none.
    """
    every = conditions()
    known = list(dict.fromkeys(one.name for one in every))
    for name in names:
        if name not in known:
            raise InputError(f"conditions must be among {', '.join(known)}, got {name!r}{meant(name, known)}")
    return [one for one in every if not names or one.name in names]


def wanted_methods(names: Sequence[str]) -> list[str]:
    """The names, all of them of methods.

    Raises:
        InputError: one that is none.
    """
    for name in names:
        if name not in METHODS:
            raise InputError(f"methods must be among {', '.join(METHODS)}, got {name!r}{meant(name, METHODS)}")
    return list(names)
