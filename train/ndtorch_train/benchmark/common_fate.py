"""`ndtorch benchmark common-fate`: who finds patches of random dots that only their common motion shows.

Compared are coherent motion, models of ours, dense optical flow and background subtraction.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
import numpy.typing as npt
import torch
from scipy.optimize import linear_sum_assignment

import ndtorch
from ndtorch.binding.readout.common_fate import coherent_patches
from ndtorch.errors import InputError
from ndtorch.scenes import CommonFate
from ndtorch.utils.packages import MODELS
from ndtorch.vision import CoherentMotion
from ndtorch_train.benchmark.base import Benchmark, Column, Split, Task, known
from ndtorch_train.benchmark.foreground import Subtraction, mask_iou
from ndtorch_train.plots import draw_common_fate
from ndtorch_train.rows import Row

Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]

MEMORY = 0.4
"""Seconds over which optical flow is averaged: that of our own correlations."""
STANDS_OUT = 10.0
"""Pixels a second by which averaged flow must differ from that of most pixels: a third of the dots' pace, not tuned."""
SMOOTH = 4.0
"""Deviation of the window in which it is averaged, pixels: that of our own closer search."""
ONE_WAY = 12.0
"""Pixels a second within which flow is of one patch."""
SMALLEST = 0.006
"""Smallest patch, as a share of the frame: that of our own."""
FIRST_SEED = {"tune": 20_000_000, "test": 21_000_000}
"""Scene i of condition k has this seed plus 10 000 k + i."""
SECONDS = 3.0
AGO = (0.8, 0.4, 0.0)
"""Seconds before the end at which a scene is scored."""


CONDITIONS: Mapping[str, tuple[float, ...]] = {
    "coherence": (1.0, 0.75, 0.5, 0.35, 0.25, 0.15),
    "density": (0.005, 0.01, 0.04),
    "lifetime": (0.12, 0.2, 0.8, math.inf),
    "ground": (0.5, 1.0),
    "patches": (0, 2, 3),
}
"""Parameters of `CommonFate` that are varied in turn, the rest as it comes."""


class Found(NamedTuple):
    """One object that a method reports: column and row of its place, and its pixels where it gives them."""

    place: tuple[float, float]
    mask: Mask | None


class Watching(Protocol):
    """Sees a scene frame by frame."""

    def __call__(self, scene: CommonFate, moments: Sequence[int]) -> list[list[Found]]:
        """What is found right after each of the frames `moments`, which ascend."""
        ...


def pieces(scene: CommonFate, moments: Sequence[int]) -> Iterator[torch.Tensor]:
    """The frames `[T, 3, H, W]` up to each moment in turn."""
    first = 0
    for moment in moments:
        yield scene.frames(first, moment + 1)
        first = moment + 1


def coherent(scene: CommonFate, moments: Sequence[int]) -> list[list[Found]]:
    """Correlators of all directions, and the closer search where motion differs."""
    motion, state, found = CoherentMotion(scene.size, 1 / scene.fps), None, []
    with torch.inference_mode():
        for frames in pieces(scene, moments):
            state = motion.advance(frames, state)
            found.append([Found(one.place, one.mask.numpy()) for one in coherent_patches(motion, state)])
    return found


class Model:
    """A model of ours that gives places.

    Args:
        name: of the model.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def __call__(self, scene: CommonFate, moments: Sequence[int]) -> list[list[Found]]:
        border = {"border": "reflect"} if self.name == "retinotopic" else {}
        model, state = ndtorch.load(self.name, size=scene.size, fps=scene.fps, **border), None
        found = []
        with torch.inference_mode():
            for frames in pieces(scene, moments):
                signals, state = model(frames, state)
                now = frames.shape[0] and model.visible_objects(state)
                found.append([Found(one.place, self.mask(one, signals, scene.size)) for one in now or [] if one.place])
        return found

    @staticmethod
    def mask(obj: Any, signals: Any, size: tuple[int, int]) -> Mask | None:
        """The silhouette of an object, of models that have them."""
        if not hasattr(signals, "labels") or not len(signals.labels):
            return None
        image = (signals.labels[-1].numpy() == (obj.track or 0) + 1).astype(np.uint8)
        return np.asarray(cv2.resize(image, size[::-1], interpolation=cv2.INTER_NEAREST)) > 0


class Flow:
    """Dense optical flow, averaged over a while; where it differs from most of the frame, and its clusters.

    Args:
        kind: "dis" or "farneback".
    """

    def __init__(self, kind: str) -> None:
        self.dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM) if kind == "dis" else None

    def flow(self, before: Any, now: Any) -> Any:
        """Columns and rows that every pixel moved, `[H, W, 2]`."""
        flow = np.zeros((*now.shape, 2), np.float32)
        if self.dis is not None:
            return self.dis.calc(before, now, flow)
        return cv2.calcOpticalFlowFarneback(before, now, flow, 0.5, 3, 15, 3, 5, 1.2, 0)

    def __call__(self, scene: CommonFate, moments: Sequence[int]) -> list[list[Found]]:
        before, mean, found = None, np.zeros((*scene.size, 2)), []
        share = 1 / (1 + MEMORY * scene.fps)
        for frames in pieces(scene, moments):
            for frame in (255 * frames[:, 0]).round().byte().numpy():
                if before is not None:
                    mean += share * (scene.fps * self.flow(before, frame) - mean)
                before = frame
            found.append(clusters(mean))
        return found


def clusters(flow: Floats) -> list[Found]:
    """Things in a field of velocities `[H, W, 2]`: its modes among what differs from the median, and their parts."""
    smooth = np.asarray(cv2.GaussianBlur(flow, (0, 0), SMOOTH))
    differs = smooth - np.median(smooth.reshape(-1, 2), 0)
    left = np.linalg.norm(differs, axis=-1) > STANDS_OUT
    found = []
    for _ in range(6):
        if left.sum() < SMALLEST * left.size:
            break
        some = differs[left][:: max(1, int(left.sum()) // 400)]
        near = np.linalg.norm(some[:, None] - some, axis=-1) < ONE_WAY
        mode = some[near[near.sum(1).argmax()]].mean(0)
        mask = left & (np.linalg.norm(differs - mode, axis=-1) < ONE_WAY)
        found += parts(mask)
        left &= ~mask
    return found


def parts(mask: Mask) -> list[Found]:
    """The connected parts of a mask that are large enough, after an opening and a closing."""
    square = np.ones((5, 5), np.uint8)
    clean = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, square)
    clean = cv2.morphologyEx(clean, cv2.MORPH_OPEN, square)
    count, labels, stats, middles = cv2.connectedComponentsWithStats(clean)
    return [
        Found((float(middles[n][0]), float(middles[n][1])), np.asarray(labels == n))
        for n in range(1, count)
        if stats[n, cv2.CC_STAT_AREA] >= SMALLEST * mask.size
    ]


def mog2(scene: CommonFate, moments: Sequence[int]) -> list[list[Found]]:
    """Background subtraction, opening and connected parts."""
    subtract, found = Subtraction("MOG2"), []
    for frames in pieces(scene, moments):
        mask = np.zeros(scene.size, dtype=bool)
        for frame in (255 * frames).round().byte().permute(0, 2, 3, 1).numpy():
            mask, _ = subtract(np.ascontiguousarray(frame))
        found.append(parts(mask))
    return found


METHODS: dict[str, Callable[[], Watching]] = {
    "coherent": lambda: coherent,
    "retinotopic": lambda: Model("retinotopic"),
    "foreground": lambda: Model("foreground"),
    "dis": lambda: Flow("dis"),
    "farneback": lambda: Flow("farneback"),
    "mog2": lambda: mog2,
}
"""Every method by its name."""


COLUMNS = (
    Column("case", "condition"),
    Column("method", "method"),
    Column("condition", "parameter"),
    Column("value", "value"),
    Column("count", "count", error="count_se", better=1),
    Column("place", "place", error="place_se", better=1),
    Column("iou", "IoU", error="iou_se", better=1),
)

USES = ("ndtorch.vision", "ndtorch.scenes", "ndtorch.binding", "ndtorch.loading", MODELS)


def fate_benchmark(methods: Sequence[str], names: Sequence[str], scenes: int, split: Split) -> Benchmark:
    """The benchmark of some methods on scenes of some conditions; of all where none are named."""
    methods = methods or list(METHODS)
    known("methods", methods, list(METHODS))
    known("conditions", names or list(CONDITIONS), list(CONDITIONS))
    if not 1 <= scenes <= 10_000:
        raise InputError(f"scenes must be between 1 and 10000, got {scenes}")
    tasks = [
        Task(
            f"{name} {value:g}, {method}",
            functools.partial(measure, name, value, FIRST_SEED[split] + 10_000 * n, scenes, method),
        )
        for n, (name, value) in enumerate((name, value) for name, values in CONDITIONS.items() for value in values)
        if not names or name in names
        for method in methods
    ]
    note = (
        f"Split {split}, {scenes} scenes a condition, seen at three moments of the last second. Ratio of right counts, "
        "F of places, mean intersection over union."
    )
    return Benchmark(
        "common-fate",
        "Random dots by common fate",
        note,
        COLUMNS,
        tasks,
        USES,
        draw=draw_common_fate,
        pivot=("count", "place", "iou"),
        settings={"split": split, "scenes": scenes},
    )


def measure(name: str, value: float, first: int, scenes: int, method: str, folder: Path) -> list[Row]:
    """The row of one method under one condition: means over scenes and moments, and standard errors."""
    changed: dict[str, Any] = {name: value}
    scores = []
    for n in range(scenes):
        scene = CommonFate(SECONDS, seed=first + n, **changed)
        moments = [scene.length - 1 - round(ago * scene.fps) for ago in AGO]
        readings = METHODS[method]()(scene, moments)
        each = [scored(f, scene.masks(m, m + 1)[0].numpy()) for f, m in zip(readings, moments, strict=True)]
        scores.append([mean_of(values) for values in zip(*each, strict=True)])
    row: Row = {"case": f"{name} {value:g}", "condition": name, "method": method}
    row["value"] = value if math.isfinite(value) else "inf"
    for key, values in zip(("count", "place", "iou"), zip(*scores, strict=True), strict=True):
        there = [v for v in values if v is not None]
        row[key] = mean_of(there)
        row[f"{key}_se"] = float(np.std(there) / math.sqrt(len(there))) if there else None
    return [row]


def mean_of(values: Sequence[float | None]) -> float | None:
    """The mean of those that are numbers; None where none is."""
    there = [float(value) for value in values if value is not None]
    return float(np.mean(there)) if there else None


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
                overlap[n, k] = mask_iou(mask, one.mask)
    pairs = linear_sum_assignment(hits, maximize=True)
    place = 2 * hits[pairs].sum() / (len(truth) + len(found))
    masks = any(one.mask is not None for one in found) or not found
    best = overlap[linear_sum_assignment(overlap, maximize=True)].sum() / len(truth)
    return right, float(place), float(best) if masks else None
