"""`ndtorch benchmark over-time`: what a model answers at every second of rendered scenes.

Frames go through the ten features, and those through every method. The ten features of a scene are kept in the folder
of the benchmark, since rendering takes longer than all methods together.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.binding.learning import settled
from ndtorch.binding.models.scale_free import OwnerReadout
from ndtorch.errors import InputError
from ndtorch.scenes import FrameSource, three_bars, two_bars
from ndtorch.utils.packages import MODELS, code_digest
from ndtorch_train.benchmark.bar_scenes import (
    FPS,
    SIZE,
    SPEED,
    WIDTH,
    RandomBar,
    RenderedBars,
    Restriction,
    Scene,
    by_group,
    direction_degrees,
    draw_scene,
    first_stage,
    present,
    true_features,
)
from ndtorch_train.benchmark.base import Benchmark, Column, Split, Task, known
from ndtorch_train.benchmark.retinotopic import ground
from ndtorch_train.benchmark.scene_scores import score_scene
from ndtorch_train.benchmark.separation import FILTERS_SETTLE, METHODS, TAU_SMOOTH, Method, Offline, Signals
from ndtorch_train.plots import draw_reliability
from ndtorch_train.rows import Row
from ndtorch_train.superposed import Stimuli, film_bars, rendered_sums

if TYPE_CHECKING:
    from ndtorch.report.page import Shown

LONGEST = 120.0
"""Seconds of every scene."""
FIRST = 10.0
"""Seconds before the first reading; from then on there is one a second."""
WINDOW = 15.0
"""Seconds of signals that offline methods get at every reading."""
FIRST_SEED = {"tune": 30_000_000, "test": 31_000_000}
"""Scene i of set k has this seed plus 10 000 k + i."""
SEEDS_A_SET = 10_000
BINS = 10
"""Of the reliability diagram."""
COVERED_FROM, COVERED_TO = 12.0, 30.0
"""Seconds between which bars of the set `crossings` cover each other for the first time."""


class Rendered(NamedTuple):
    """A scene to render and the features of its bars, `[bars, 10]` bool."""

    source: FrameSource
    truth: Tensor


def random_scene(seed: int, number: int, share: float, fps: float) -> Rendered:
    """One to four bars in turn."""
    return of_bars(draw_scene(seed, Restriction(number % 4 + 1), LONGEST), fps)


def crossing_scene(seed: int, number: int, share: float, fps: float) -> Rendered:
    """Two or three bars; each of the later ones covers the first one at a time between `COVERED_FROM` and `_TO`."""
    scene, rng = draw_scene(seed, Restriction(number % 2 + 2), LONGEST), np.random.default_rng(seed + SEEDS_A_SET)
    bars = [scene.bars[0]]
    for bar in scene.bars[1:]:
        while bar.direction == bars[0].direction:
            bar = replace(bar, direction=int(rng.integers(16)))
        moment, off = rng.uniform(COVERED_FROM, COVERED_TO), rng.uniform(-WIDTH / 2, WIDTH / 2, 2)
        there = place(bars[0], moment) + off
        start = np.array(bar.start) + there - place(bar, moment)
        bars.append(replace(bar, start=(float(start[0] % SIZE[1]), float(start[1] % SIZE[0]))))
    return of_bars(Scene(seed, tuple(bars)), fps)


def border_scene(seed: int, number: int, share: float, fps: float) -> Rendered:
    """One to three bars, the first of which moves along an edge of the image and is cut by it."""
    scene, rng = draw_scene(seed, Restriction(number % 3 + 1), LONGEST), np.random.default_rng(seed + SEEDS_A_SET)
    first, along = scene.bars[0], int(rng.integers(4))
    cut = float(rng.uniform(-WIDTH / 2, WIDTH / 2))
    start = (first.start[0], cut % SIZE[0]) if along % 2 == 0 else (cut % SIZE[1], first.start[1])
    return of_bars(Scene(seed, (replace(first, direction=4 * along, start=start), *scene.bars[1:])), fps)


def textured_scene(seed: int, number: int, share: float, fps: float) -> Rendered:
    """One to three bars over smooth noise of .1 to .5."""
    scene = of_bars(draw_scene(seed, Restriction(number % 3 + 1), LONGEST), fps)
    assert isinstance(scene.source, RenderedBars)
    scene.source.ground = ground(seed)
    return scene


def paper_scene(
    seed: int, number: int, share: float, fps: float, *, bars: int, fluctuation: str = "shadow"
) -> Rendered:
    """The papers' bars, at a phase that is `share` of a cycle, from places that depend on the seed."""
    rng = np.random.default_rng(seed)
    # The reference scenes themselves are in the split test.
    moved = (0.0, 0.0) if fluctuation == "shadow" and seed >= FIRST_SEED["test"] else tuple(rng.uniform(-60, 60, 2))
    build = two_bars if bars == 2 else three_bars
    # Bars that come and go in step are alike in everything that fluctuates.
    phase = 30 + 300 * share if fluctuation == "distance" else 360 * share
    source = build(LONGEST, phase=phase, fluctuation=fluctuation, shift=moved, seed=seed, fps=fps)
    return Rendered(source, paper_truth()[:bars])


class SceneSet(NamedTuple):
    """A set: how a scene is drawn from its seed, its number, its share of the set and frames a
    second; how many for each one asked."""

    draw: Callable[[int, int, float, float], Rendered]
    times: int = 1


SETS: Mapping[str, SceneSet] = {
    "random": SceneSet(random_scene, 4),
    "two bars": SceneSet(functools.partial(paper_scene, bars=2), 2),
    "three bars": SceneSet(functools.partial(paper_scene, bars=3), 2),
    "distance": SceneSet(functools.partial(paper_scene, bars=2, fluctuation="distance")),
    "random shadow": SceneSet(functools.partial(paper_scene, bars=2, fluctuation="random")),
    "crossings": SceneSet(crossing_scene),
    "border": SceneSet(border_scene),
    "textured ground": SceneSet(textured_scene),
}
"""Sets by name."""


def of_bars(scene: Scene, fps: float) -> Rendered:
    """A drawn scene as frames on black."""
    return Rendered(RenderedBars(scene, LONGEST, fps), true_features([scene], first_stage())[0])


def place(bar: RandomBar, seconds: float) -> np.ndarray:
    """Column and row of its center, not wrapped."""
    angle = math.radians(direction_degrees(bar.direction))
    return np.array(bar.start) + SPEED * seconds * np.array([math.cos(angle), -math.sin(angle)])


@functools.cache
def paper_truth() -> Tensor:
    """Features of the papers' red, green and blue bar in the sine shadow, `[3, 10]` bool."""
    bars = Stimuli(film_bars())
    own = torch.stack([bars.red(LONGEST), bars.green([90.0], LONGEST)[0], bars.blue([0.0], LONGEST)[0]])
    return present(by_group(own.std(1)) @ settled(first_stage()).T)


def scenes_of(name: str, split: Split, scenes: int, fps: float = FPS) -> list[Callable[[], Rendered]]:
    """What draws each scene of a set. Raises `InputError`: a number of scenes that is not positive, or has no seeds."""
    chosen = SETS[name]
    count = chosen.times * scenes
    if not 1 <= count <= SEEDS_A_SET:
        raise InputError(f"scenes must be between 1 and {SEEDS_A_SET // chosen.times}, got {scenes}")
    first = FIRST_SEED[split] + SEEDS_A_SET * list(SETS).index(name)
    # The phases of the two splits lie between each other.
    off = 0.5 if split == "tune" else 0.0
    return [functools.partial(chosen.draw, first + n, n, (n + off) / count, fps) for n in range(count)]


def kept_sums(scene: Callable[[], Rendered], seconds: float, path: Path) -> Tensor:
    """The ten sums of a scene's frames, `[T, 10]`: from the file, or rendered and kept there."""
    if path.exists():
        return torch.from_numpy(np.load(path))
    source = scene().source
    source.length = round(seconds * source.fps)
    sums = rendered_sums(source)
    path.parent.mkdir(parents=True, exist_ok=True)
    half = path.with_suffix(".half.npy")
    np.save(half, sums.numpy())
    half.replace(path)
    return sums


class Answers(NamedTuple):
    """Answers at every second of the scenes of a set, `[B, S]`: number, whether it and all features are right, and
    the confidence of the number."""

    number: npt.NDArray[np.int64]
    ok: npt.NDArray[np.bool_]
    confidence: npt.NDArray[np.float64] | None = None


def answers(method: Method, sums: Tensor, fps: float, truth: Sequence[Tensor], times: Sequence[float]) -> Answers:
    """The answers at `times`, seconds from the first frame, of an online method."""
    readings = method(sums, fps, times)
    scores = [[score_scene(f, t) for f, t in zip(one.found, truth, strict=True)] for one in readings]
    number, ok = (np.array([[getattr(s, key) for s in at] for at in scores]).T for key in ("found", "ok"))
    sure = [one.confidence for one in readings]
    return Answers(number, ok, None if None in sure else np.array(sure, np.float64).T)


def window_answers(
    method: Offline, sums: Tensor, fps: float, truth: Sequence[Tensor], times: Sequence[float]
) -> Answers:
    """The same of an offline method, which gets the last `WINDOW` seconds of signals each time."""
    refined, stride = Signals(fps)(sums), max(1, round(TAU_SMOOTH * fps))
    scores = []
    for signals, bars in zip(refined, truth, strict=True):
        since = [max(FILTERS_SETTLE, time - WINDOW) for time in times]
        cut = [signals[round(a * fps) : round(b * fps) : stride] for a, b in zip(since, times, strict=True)]
        scores.append([score_scene(present(method.separate(piece)), bars) for piece in cut])
    return Answers(*(np.array([[getattr(s, key) for s in at] for at in scores]) for key in ("found", "ok")))


def measure(
    name: str, methods: Sequence[str], split: Split, scenes: int, seconds: float, fps: float, folder: Path
) -> list[Row]:
    """Rows of all methods on one set."""
    drawn = scenes_of(name, split, scenes, fps)
    code = code_digest(("ndtorch.vision", "ndtorch.scenes"))[:8]
    sums, truth = [], []
    for n, scene in enumerate(drawn):
        file = folder / "sums" / f"{name.replace(' ', '-')}-{split}-{len(drawn)}-{n}-{seconds:g}s-{fps:g}-{code}.npy"
        sums.append(kept_sums(scene, seconds, file))
        truth.append(scene().truth)
    times = [float(n) for n in range(round(FIRST), math.floor(seconds) + 1)]
    bars = np.array([len(one) for one in truth])[:, None]
    rows: list[Row] = []
    for method in methods:
        chosen = METHODS[method](truth)
        if isinstance(chosen, Offline):
            found = window_answers(chosen, torch.stack(sums), fps, truth, times)
        else:
            found = answers(chosen, torch.stack(sums), fps, truth, times)
        right = found.number == bars
        sure = Bins.of(found.confidence, right)
        changes = (np.diff(found.number, axis=1) != 0).sum() / max(1e-9, len(bars) * (times[-1] - times[0]) / 60)
        rows.append(
            {
                "set": name,
                "method": method,
                "scenes": len(bars),
                "seconds": seconds,
                "count": float(right.mean()),
                "ok": float(found.ok.mean()),
                "throughout": float(right.all(1).mean()),
                "changes": float(changes),
                **({} if sure is None else sure.row()),
            }
        )
    return rows


COLUMNS = (
    Column("set", "set"),
    Column("method", "method"),
    Column("scenes", "scenes"),
    Column("seconds", "until, s", 0),
    Column("count", "seconds right", 3, better=1),
    Column("ok", "and every feature", 3, better=1),
    Column("throughout", "scenes right throughout", 3, better=1),
    Column("changes", "changes a minute", 1, better=-1),
    Column("stable", "stable", 2),
    Column("stable_right", "right when stable", 3, better=1),
    Column("error", "calibration error", 3, better=-1),
)


class Bins(NamedTuple):
    """Answers by their confidence, in `BINS` bins of equal width: how many, how many right, sum of the confidence;
    and how many are stable, and right of these."""

    answers: npt.NDArray[np.int64]
    right: npt.NDArray[np.int64]
    confidence: npt.NDArray[np.float64]
    stable: tuple[int, int]

    @classmethod
    def of(cls, confidence: npt.NDArray[np.float64] | None, right: npt.NDArray[np.bool_]) -> Bins | None:
        """Of answers; None without a confidence."""
        if confidence is None:
            return None
        at = np.minimum((confidence * BINS).astype(int), BINS - 1).ravel()
        sums = [np.bincount(at, weights, BINS) for weights in (None, right.ravel(), confidence.ravel())]
        stable = confidence >= OwnerReadout().certain
        return cls(sums[0], sums[1].astype(int), sums[2].astype(float), (int(stable.sum()), int(right[stable].sum())))

    def row(self) -> Row:
        """What the table shows, and the bins."""
        stable, stable_right = self.stable
        found: Row = {"bins": [part.tolist() for part in self[:3]], "stable": stable / max(1, self.answers.sum())}
        # Expected calibration error: mean distance of ratio and confidence over bins.
        found["error"] = float(np.abs(self.right - self.confidence).sum() / max(1, self.answers.sum()))
        return {**found, "stable_right": stable_right / stable if stable else None, "of_stable": self.stable}


def in_all(rows: list[Row]) -> list[Row]:
    """Stable and calibration error of every method over all sets."""
    found: list[Row] = []
    for method in dict.fromkeys(row["method"] for row in rows if "bins" in row):
        own = [row for row in rows if row["method"] == method]
        count, right, confidence = np.sum([row["bins"] for row in own], 0)
        stable = np.sum([row["of_stable"] for row in own], 0)
        every = Bins(count.astype(int), right.astype(int), confidence, (int(stable[0]), int(stable[1])))
        found.append({"set": "all", "method": method, "scenes": sum(row["scenes"] for row in own), **every.row()})
    return found


def reliability(rows: list[Row], folder: Path) -> list[Shown]:
    """A diagram of all sets together, of methods with a confidence."""
    every = in_all(rows)
    return draw_reliability(every, folder) if every else []


def over_time_benchmark(
    methods: Sequence[str], sets: Sequence[str], scenes: int, seconds: float, split: Split, fps: float = FPS
) -> Benchmark:
    """The benchmark of some methods on some sets."""
    known("methods", methods, list(METHODS))
    known("sets", sets, list(SETS))
    if not FIRST < seconds <= LONGEST:
        raise InputError(f"seconds must lie above {FIRST:g} and be at most {LONGEST:g}, got {seconds:g}")
    if not 0 < fps <= FPS or FPS % fps:
        raise InputError(f"fps must be {FPS:g} or a whole part of it, got {fps:g}")
    for name in sets:
        scenes_of(name, split, scenes)
    tasks = [Task(name, functools.partial(measure, name, tuple(methods), split, scenes, seconds, fps)) for name in sets]
    note = (
        f"Split {split}, rendered {fps:g} times a second. Number and table of objects are read at every second from "
        f"{FIRST:g} s to {seconds:g} s. seconds right: ratio of readings with the right number; and every feature: "
        "number and features are right; scenes right throughout: ratio of scenes whose number is always right; changes "
        "a minute: of the number; stable: ratio of readings with a confidence of .9 or more. Offline methods get the "
        f"last {WINDOW:g} s."
    )
    settings = {"split": split, "scenes": scenes, "seconds": seconds, "fps": fps, "methods": list(methods)}
    uses = ("ndtorch.vision", "ndtorch.scenes", "ndtorch.binding", "ndtorch.loading", MODELS)
    title = "Binding over time"
    return Benchmark("over-time", title, note, COLUMNS, tasks, uses, in_all, reliability, settings=settings)
