"""`ndtorch benchmark over-time`: number and features of moving bars, second by second, beside simple peers."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor

import ndtorch
from ndtorch.binding.network import settled
from ndtorch.binding.objects import features_by_group
from ndtorch.vision import GROUPS
from ndtorch.vision.temporal import HighPass
from ndtorch_train.benchmark.bar_scenes import CONDITIONS, SECONDS, BarFilm, Sums, draw_film, first_stage, kept_sums
from ndtorch_train.benchmark.base import Benchmark, Column, Row, Split, Task, known
from ndtorch_train.plots import draw_reliability

if TYPE_CHECKING:
    from ndtorch.report.page import Shown

FIRST = 15
"""Seconds before the first reading; from then on there is one a second."""
WINDOW = 10.0
"""Seconds of signals that peers without a state get at every reading."""
GOOD_F1 = 0.75
"""F1 of features that each bar must reach."""
CERTAIN = 0.9
"""Confidence from which on a number is called stable."""
BINS = 10
"""Bins of confidence of the reliability diagram."""


class Reading(NamedTuple):
    """What a method answers at one moment: a number, features of the objects `[n, 10]` bool where it gives any, and the
    confidence of the number where it has one."""

    number: int
    features: Tensor | None = None
    confidence: float | None = None


Method = Callable[[BarFilm, Sums, Sequence[int]], list[Reading]]
"""Film, its sums and seconds of reading -> readings."""


def windows(sums: Sums, seconds: Sequence[int]) -> list[Tensor]:
    """High-passed sums of the last `WINDOW` seconds before each reading, each group over its largest deviation."""
    high = HighPass(2.0, 1 / sums.fps, sample_dims=1)(sums.sums)[0].double()
    cut = [high[round((second - WINDOW) * sums.fps) : round(second * sums.fps)] for second in seconds]
    scaled = []
    for part in cut:
        deviations = [part[:, group].std(0).max().clamp_min(1e-12) for group in GROUPS.values()]
        scaled.append(torch.cat([part[:, g] / d for g, d in zip(GROUPS.values(), deviations, strict=True)], -1))
    return scaled


def color_rank(film: BarFilm, sums: Sums, seconds: Sequence[int]) -> list[Reading]:
    """Number of eigenvalues of the covariance of the three color sums above 1e-4 of the largest."""
    values = [torch.linalg.eigvalsh(part[:, GROUPS["color"]].mT.cov()) for part in windows(sums, seconds)]
    return [Reading(int((each > 1e-4 * each[-1]).sum())) for each in values]


def fast_ica(film: BarFilm, sums: Sums, seconds: Sequence[int]) -> list[Reading]:
    """FastICA with as many components as the covariance of the ten sums has eigenvalues above 1 % of the largest."""
    from sklearn.decomposition import FastICA

    readings = []
    for part in windows(sums, seconds):
        values = torch.linalg.eigvalsh(part.mT.cov())
        number = int((values > 0.01 * values[-1]).sum())
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mixing = FastICA(number, whiten="unit-variance", random_state=0, max_iter=200).fit(part.numpy()).mixing_.T
        mixing = torch.from_numpy(mixing * np.sign(mixing.sum(-1, keepdims=True))).float()
        refined = features_by_group(mixing, 0.0) @ settled(first_stage()).mT
        readings.append(Reading(number, features_by_group(refined) > 0))
    return readings


def whole_field(film: BarFilm, sums: Sums, seconds: Sequence[int], *, model: str) -> list[Reading]:
    """A model of sums over the whole field, from the sums of the film."""
    module: Any = ndtorch.load(model, size=film.size, fps=film.fps)
    state, readings, done = None, list[Reading](), 0
    with torch.inference_mode():
        for second in seconds:
            upto = round(second * film.fps)
            _, state = module.from_sums(sums.sums[done:upto], state)
            done = upto
            rows = [[thing.features.get(name, 0.0) > 0 for name in ndtorch.FEATURES] for thing in module.objects(state)]
            sure = module.confidence(state)
            readings.append(Reading(len(rows), torch.tensor(rows).reshape(-1, 10), sure))
    return readings


def retinotopic(film: BarFilm, sums: Sums, seconds: Sequence[int]) -> list[Reading]:
    """The retinotopic model, which needs the frames."""
    module, state, readings = ndtorch.load("retinotopic", size=film.size, fps=film.fps), None, list[Reading]()
    ends = {round(second * film.fps) for second in seconds}
    with torch.inference_mode():
        for start in range(0, max(ends), 10):
            _, state = module(film.frames(start, start + 10), state)
            if start + 10 in ends:
                rows = [[one.features.get(name, 0.0) > 0 for name in ndtorch.FEATURES] for one in module.objects(state)]
                readings.append(Reading(len(rows), torch.tensor(rows).reshape(-1, 10)))
    return readings


METHODS: Mapping[str, Method] = {
    "scale-free": functools.partial(whole_field, model="scale-free"),
    "published": functools.partial(whole_field, model="published"),
    "retinotopic": retinotopic,
    "color rank": color_rank,
    "FastICA": fast_ica,
}


def features_right(found: Tensor, truth: Tensor) -> bool:
    """Whether every bar `[bars, 10]` has an object `[objects, 10]` of its own with an F1 of features of `GOOD_F1`."""
    if len(found) != len(truth):
        return False
    both = (truth[:, None] & found).sum(-1).double()
    f1 = 2 * both / (truth.sum(-1)[:, None] + found.sum(-1)).clamp_min(1)
    rows, columns = linear_sum_assignment(f1.numpy(), maximize=True)
    return bool((f1[rows, columns] >= GOOD_F1).all())


def measure(name: str, methods: Sequence[str], split: Split, films: int, folder: Path) -> list[Row]:
    """Rows of all methods on one condition."""
    seconds = range(FIRST, math.floor(SECONDS) + 1)
    answers: dict[str, list[tuple[bool, bool, float | None]]] = {method: [] for method in methods}
    for number in range(films):
        film = draw_film(name, split, number)
        sums = kept_sums(film, folder / "sums" / f"{list(CONDITIONS).index(name)}-{split}-{number}.npz")
        for method in methods:
            for second, reading in zip(seconds, METHODS[method](film, sums, seconds), strict=True):
                truth = sums.truth[[a <= second < b or b == SECONDS for a, b in sums.shown]]
                features = reading.features is not None and features_right(reading.features, truth)
                answers[method].append((reading.number == len(truth), features, reading.confidence))
    rows: list[Row] = []
    for method, given in answers.items():
        right, complete, confidence = zip(*given, strict=True)
        row: Row = {"films": name, "method": method, "count": float(np.mean(right))}
        row["features"] = float(np.mean(complete)) if method != "color rank" else None
        if confidence[0] is not None:
            row["bins"] = bins(np.array(confidence), np.array(right))
            row |= summary(np.array(row["bins"]))
        rows.append(row)
    return rows


def bins(confidence: np.ndarray, right: np.ndarray) -> list[list[float]]:
    """Answers, right answers and sum of the confidence in bins of confidence, `[3, BINS]`."""
    at = np.minimum((confidence * BINS).astype(int), BINS - 1)
    return [np.bincount(at, weights, BINS).tolist() for weights in (None, right, confidence)]


def summary(counts: np.ndarray) -> Row:
    """Ratio of stable answers, of right ones among them, and expected calibration error."""
    answers, right, confidence = counts
    stable = round(CERTAIN * BINS)
    return {
        "stable": float(answers[stable:].sum() / answers.sum()),
        "stable_right": float(right[stable:].sum() / answers[stable:].sum()) if answers[stable:].any() else None,
        "error": float(np.abs(right - confidence).sum() / answers.sum()),
    }


def in_all(rows: list[Row]) -> list[Row]:
    """A row of each method over all conditions."""
    every: list[Row] = []
    for method in dict.fromkeys(row["method"] for row in rows):
        own = [row for row in rows if row["method"] == method]
        row: Row = {"films": "all", "method": method, "count": float(np.mean([one["count"] for one in own]))}
        if "bins" in own[0]:
            row["bins"] = np.sum([one["bins"] for one in own], 0).tolist()
            row |= summary(np.array(row["bins"]))
        every.append(row)
    return every


def draw(rows: list[Row], folder: Path) -> list[Shown]:
    """The reliability diagram of methods with a confidence."""
    sure = [row for row in in_all(rows) if "bins" in row]
    return draw_reliability(sure, folder) if sure else []


COLUMNS = (
    Column("films", "films"),
    Column("method", "method"),
    Column("count", "number right", 2, better=1),
    Column("features", "and every feature", 2, better=1),
    Column("stable", "stable", 2),
    Column("stable_right", "right when stable", 2, better=1),
    Column("error", "calibration error", 2, better=-1),
)


def over_time_benchmark(methods: Sequence[str], films: Sequence[str], count: int, split: Split) -> Benchmark:
    """The benchmark of some methods on some conditions, with so many films of each."""
    known("methods", methods, list(METHODS))
    known("films", films, list(CONDITIONS))
    note = (
        f"Split {split}, {count} films a row. Ratio of seconds from {FIRST} s to {SECONDS:g} s: the number of bars in "
        "view is right; so are the features of each; the confidence is .9 or more (stable), and the number right then."
    )
    tasks = [Task(name, functools.partial(measure, name, tuple(methods), split, count)) for name in films]
    settings = {"split": split, "count": count, "methods": list(methods)}
    return Benchmark("over-time", "Bars over time", note, COLUMNS, tasks, in_all, draw, settings=settings)
