"""`ndtorch benchmark foreground`: the model for video beside two fixed trackers of background subtraction, on labelled
clips.

A clip is a folder with `clip.mp4`, and `gt.txt` (boxes in MOT format) or `masks.mkv` (255 moving, 0 not, 128 ignored).
"""

from __future__ import annotations

import functools
import itertools
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import torch
from scipy.optimize import linear_sum_assignment

import ndtorch
from ndtorch.errors import InputError
from ndtorch.loading import model_kind
from ndtorch.run.opening import CAMERA_MODELS
from ndtorch.scenes.video import reduced
from ndtorch.utils.packages import need
from ndtorch_train.benchmark.base import Benchmark, Column, Row, Split, Task, known, means

Pixels = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]

MOVING, IGNORED = 200, 100
"""Grey value of a true mask from which on a pixel moves, and from which on it is not counted."""
SMALLEST = 0.0005
"""Smallest blob, true or of a peer, as a fraction of the image."""
AROUND_PX = 3
"""A position may lie this far outside a true blob."""
CALL = 12
"""Frames that a model is given at once, as by `ndtorch bind`."""
OVERLAP = 0.5
"""Boxes match from this intersection over union on."""
SORT_OVERLAP, SORT_LOST_S, SORT_HITS = 0.3, 1.0, 3
"""SORT: smallest overlap of a match, seconds without one after which a track ends, and matches that confirm it."""

METHODS = ("foreground", "mog2-sort", "knn-bytetrack")
"""The model for video, and its peers; the last needs the package `trackers`."""

COLUMNS = (
    Column("clip", "clip"),
    Column("method", "method"),
    Column("precision", "precision", better=1),
    Column("recall", "recall", better=1),
    Column("f", "F", better=1),
    Column("box_f", "F of boxes", better=1),
    Column("idf1", "IDF1", better=1),
    Column("count_error", "count error", better=-1),
    Column("mask_f", "mask F", better=1),
    Column("ms_per_frame", "ms a frame", better=-1),
    Column("times_mog2", "times MOG2", better=-1),
)
NOTE = (
    "A position is right inside a true box or blob. Processor time of one thread, without decoding, and its ratio to "
    "MOG2 with its contours, which sees the same frames in turns: the median over calls of 12 frames."
)


class Clip(NamedTuple):
    """A labelled clip: its folder, frames a second, and height and width of its frames."""

    folder: Path
    fps: float
    size: tuple[int, int]

    def frames(self, name: str = "clip.mp4") -> Iterator[Pixels]:
        """The frames `[H, W, 3]` of one of its films, in blue, green, red."""
        capture = cv2.VideoCapture(str(self.folder / name))
        while True:
            there, frame = capture.read()
            if not there:
                return
            yield np.asarray(frame, np.uint8)

    def calls(self) -> Iterator[list[Pixels]]:
        """The frames, so many at a time."""
        frames = self.frames()
        while call := list(itertools.islice(frames, CALL)):
            yield call


@dataclass
class Report:
    """What a method reports of a clip.

    Attributes:
        rows: per frame the objects, each track, column, row, left, top, right, bottom in pixels of the clip, `[N, 7]`.
        masks: per frame what moves, of clips with true masks.
        seconds: processor time of each call.
    """

    rows: list[Floats] = field(default_factory=list)
    masks: list[Mask] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


def foreground_benchmark(methods: Sequence[str], folder: Path, split: Split) -> Benchmark:
    """The benchmark of some methods, or folders of models, on the clips of a folder."""
    known("methods", [name for name in methods if not Path(name).is_dir()] or METHODS, METHODS)
    places = [folder] if (folder / "clip.mp4").is_file() else sorted(path.parent for path in folder.glob("*/clip.mp4"))
    if not places:
        raise InputError(f"{folder} holds no folder with a clip.mp4")
    clips = [read_clip(place) for place in places]
    tasks = [
        Task(f"{clip.folder.name}, {method}", functools.partial(measure, method, clip))
        for clip in clips
        for method in methods
    ]
    title, settings = "Objects in video with ground truth", {"folder": str(folder), "split": split}
    return Benchmark("foreground", title, NOTE, COLUMNS, tasks, mean_rows, settings=settings)


def read_clip(folder: Path) -> Clip:
    """The clip of a folder. Raises `InputError`: no video, or no truth."""
    capture = cv2.VideoCapture(str(folder / "clip.mp4"))
    fps, width, height = (capture.get(k) for k in (cv2.CAP_PROP_FPS, 3, 4))
    if not (fps > 0 and width and height):
        raise InputError(f"{folder / 'clip.mp4'} is not a video that can be decoded")
    if not any((folder / name).is_file() for name in ("gt.txt", "masks.mkv")):
        raise InputError(f"{folder} holds neither gt.txt nor masks.mkv")
    return Clip(folder, fps, (int(height), int(width)))


def measure(method: str, clip: Clip, out: Path) -> list[Row]:
    """The row of one method on one clip."""
    subtract, peer, frames = Subtraction("MOG2"), list[float](), 0
    steps = run_peer(method, clip) if method in METHODS[1:] else run_model(method, clip)
    for call, report in steps:  # noqa: B007 - the last is whole
        began, frames = time.process_time(), frames + len(call)
        for frame in call:
            subtract(frame)
        peer.append(time.process_time() - began)
    # The first call may compile.
    ratio = float(np.median(np.divide(report.seconds, peer)[len(peer) > 1 :]))
    times = {"ms_per_frame": 1e3 * sum(report.seconds) / frames, "times_mog2": ratio}
    return [{"clip": clip.folder.name, "method": method, **score(report, clip), **times}]


def mean_rows(rows: list[Row]) -> list[Row]:
    """The mean of every method over all clips."""
    methods = dict.fromkeys(row["method"] for row in rows)
    each = {method: [row for row in rows if row["method"] == method] for method in methods}
    return [{"clip": "mean", "method": method, **means(own, COLUMNS[2:])} for method, own in each.items()]


def run_model(name: str, clip: Clip) -> Iterator[tuple[list[Pixels], Report]]:
    """A model with tracks: every call and the report so far, whole after the last."""
    report, rows = Report(), min(clip.size[0], CAMERA_MODELS.get(model_kind(name), clip.size[0]))
    size = (rows, max(8, round(rows * clip.size[1] / clip.size[0] / 8) * 8)) if rows < clip.size[0] else clip.size
    model, state, masked = ndtorch.load(name, size=size, fps=clip.fps), None, (clip.folder / "masks.mkv").is_file()
    for call in clip.calls():
        small = np.stack([reduced(frame, size) if size != clip.size else frame for frame in call])
        frames = torch.from_numpy(small[..., ::-1].copy()).permute(0, 3, 1, 2)
        began = time.process_time()
        with torch.inference_mode():
            signals, state = model(frames, state)
        report.seconds.append(time.process_time() - began)
        report.rows += [np.zeros((0, 7)) for _ in call]
        for mask in signals.mask.numpy() if masked else ():
            wide = cv2.resize(mask * np.uint8(255), clip.size[::-1], interpolation=cv2.INTER_LINEAR)
            report.masks.append(np.asarray(wide) > 127)
        yield call, report
    scale = np.array([clip.size[1] / size[1], clip.size[0] / size[0]] * 3)
    for thing in model.objects(state):
        for (at, *place), box in zip(thing.path, thing.boxes, strict=True):
            k = round(at * clip.fps)
            row = np.concatenate([[thing.track or 0], np.array((*place, *box)) * scale])
            report.rows[k] = np.concatenate([report.rows[k], row[None]])


def run_peer(name: str, clip: Clip) -> Iterator[tuple[list[Pixels], Report]]:
    """Background subtraction with a tracker of boxes: every call and the report so far."""
    kind, _, tracker = name.partition("-")
    subtract, track, report = Subtraction(kind.upper()), TRACKERS[tracker](clip.fps), Report()
    masked = (clip.folder / "masks.mkv").is_file()
    for call in clip.calls():
        seconds = 0.0
        for frame in call:
            began = time.process_time()
            mask, boxes = subtract(frame)
            numbers, boxes = track(boxes)
            seconds += time.process_time() - began
            middles = (boxes[:, :2] + boxes[:, 2:]) / 2
            report.rows.append(np.concatenate([numbers[:, None], middles, boxes], 1))
            if masked:
                report.masks.append(mask)
        report.seconds.append(seconds)
        yield call, report


class Subtraction:
    """Background subtraction of OpenCV, MOG2 or KNN, with its defaults: opened mask, and boxes of contours `[N, 4]`."""

    def __init__(self, kind: str) -> None:
        self.model: Any = getattr(cv2, f"createBackgroundSubtractor{kind}")()

    def __call__(self, frame: Pixels) -> tuple[Mask, Floats]:
        mask = cv2.morphologyEx((self.model.apply(frame) == 255).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3)))
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        large = [cv2.boundingRect(one) for one in contours if cv2.contourArea(one) >= SMALLEST * mask.size]
        boxes = np.array(large, np.float64).reshape(-1, 4)
        boxes[:, 2:] += boxes[:, :2]
        return np.asarray(mask, np.uint8) > 0, boxes


class Sort:
    """SORT (Bewley et al. 2016) with a mean velocity in place of the Kalman filter: numbers and boxes of this frame."""

    def __init__(self, fps: float) -> None:
        self.boxes, self.velocity = np.zeros((0, 4)), np.zeros((0, 4))
        self.hits, self.lost, self.numbers = (np.zeros(0, np.int64) for _ in range(3))
        self.max_lost, self.count = max(1, round(SORT_LOST_S * fps)), 0

    def __call__(self, boxes: Floats) -> tuple[npt.NDArray[np.int64], Floats]:
        expected = self.boxes + self.velocity
        ratios = overlaps(expected, boxes)
        i, j = linear_sum_assignment(-ratios)
        i, j = i[ratios[i, j] >= SORT_OVERLAP], j[ratios[i, j] >= SORT_OVERLAP]
        self.velocity[i] += (boxes[j] - expected[i]) / 2
        self.boxes, self.lost = expected, self.lost + 1
        self.boxes[i], self.lost[i] = boxes[j], 0
        self.hits[i] += 1
        new = np.setdiff1d(np.arange(len(boxes)), j)
        self.boxes = np.concatenate([self.boxes, boxes[new]])
        self.velocity = np.concatenate([self.velocity, np.zeros((len(new), 4))])
        self.hits = np.concatenate([self.hits, np.ones(len(new), np.int64)])
        self.lost = np.concatenate([self.lost, np.zeros(len(new), np.int64)])
        self.numbers = np.concatenate([self.numbers, self.count + np.arange(len(new))])
        self.count += len(new)
        keep = self.lost <= self.max_lost
        for name in ("boxes", "velocity", "hits", "lost", "numbers"):
            setattr(self, name, getattr(self, name)[keep])
        shown = (self.lost == 0) & (self.hits >= SORT_HITS)
        return self.numbers[shown], self.boxes[shown]


class ByteTrack:
    """ByteTrack of the package `trackers`, with its defaults."""

    def __init__(self, fps: float) -> None:
        self.detections = need("supervision", "the method knn-bytetrack").Detections
        self.tracker = need("trackers", "the method knn-bytetrack").ByteTrackTracker(frame_rate=fps)

    def __call__(self, boxes: Floats) -> tuple[npt.NDArray[np.int64], Floats]:
        sure, kind = np.ones(len(boxes), np.float32), np.zeros(len(boxes), int)
        found = self.tracker.update(self.detections(boxes, confidence=sure, class_id=kind))
        numbers = np.array([] if found.tracker_id is None else found.tracker_id, np.int64)
        return numbers[numbers >= 0], np.asarray(found.xyxy, np.float64).reshape(-1, 4)[: len(numbers)][numbers >= 0]


TRACKERS: dict[str, Callable[[float], Any]] = {"sort": Sort, "bytetrack": ByteTrack}


def overlaps(one: Floats, other: Floats) -> Floats:
    """Intersection over union of every pair of boxes, `[K, N]`."""
    common = np.minimum(one[:, None, 2:], other[None, :, 2:]) - np.maximum(one[:, None, :2], other[None, :, :2])
    shared = common.clip(0).prod(-1)
    areas = [(boxes[:, 2:] - boxes[:, :2]).prod(-1) for boxes in (one, other)]
    return np.asarray(shared / np.maximum(areas[0][:, None] + areas[1] - shared, 1e-9))


def mask_iou(one: Mask, other: Mask) -> float:
    """Intersection over union of two masks."""
    return float((one & other).sum() / max(1, (one | other).sum()))


class Truth(NamedTuple):
    """One frame: whether each of K objects holds a position, their numbers and boxes (of `gt.txt`), and which pixels
    move and count (of `masks.mkv`)."""

    holds: Callable[[Floats], Mask]
    numbers: list[int] | None = None
    boxes: Floats | None = None
    moving: Mask | None = None
    counted: Mask | None = None


def truth_of(clip: Clip) -> Iterator[Truth]:
    """The truth of every frame."""
    if not (clip.folder / "gt.txt").is_file():
        smallest = SMALLEST * clip.size[0] * clip.size[1]
        for frame in clip.frames("masks.mkv"):
            moving = frame[..., 0] > MOVING
            wide = cv2.dilate(moving.astype(np.uint8), np.ones((2 * AROUND_PX + 1, 2 * AROUND_PX + 1)))
            count, labels = cv2.connectedComponents(wide)
            names = np.flatnonzero(np.bincount(labels[moving], minlength=count)[1:] >= smallest) + 1
            holds = functools.partial(in_blobs, np.asarray(labels), names)
            yield Truth(holds, moving=moving, counted=moving | (frame[..., 0] < IGNORED))
        return
    table = np.loadtxt(clip.folder / "gt.txt", delimiter=",", ndmin=2)
    table = table[table[:, 6] > 0]
    for number in itertools.count(1):
        own = table[table[:, 0] == number]
        boxes = np.concatenate([own[:, 2:4], own[:, 2:4] + own[:, 4:6]], 1)
        yield Truth(functools.partial(in_boxes, boxes), own[:, 1].astype(int).tolist(), boxes)


def in_blobs(labels: npt.NDArray[Any], names: npt.NDArray[Any], places: Floats) -> Mask:
    """Whether blobs hold positions, `[K, N]`."""
    columns, rows = places.T.astype(int)
    at = labels[rows.clip(0, labels.shape[0] - 1), columns.clip(0, labels.shape[1] - 1)]
    return np.asarray(names[:, None] == at)


def in_boxes(boxes: Floats, places: Floats) -> Mask:
    """Whether boxes hold positions, `[K, N]`."""
    inside = (boxes[:, None, :2] <= places) & (places <= boxes[:, None, 2:])
    return np.asarray(inside.all(-1))


def score(report: Report, clip: Clip) -> Row:
    """Precision, recall and F of positions, F of boxes, IDF1, count error, and F of pixels; None where the truth does
    not say."""
    true = reported = right = boxes = away = frames = 0
    together, pixels = Counter[tuple[int, int]](), np.zeros(3, np.int64)
    for number, (rows, truth) in enumerate(zip(report.rows, truth_of(clip), strict=False)):
        inside = truth.holds(rows[:, 1:3])
        right += int(inside[linear_sum_assignment(~inside)].sum())
        true, reported, frames = true + len(inside), reported + len(rows), frames + 1
        away += abs(len(inside) - len(rows))
        if truth.boxes is not None and truth.numbers is not None:
            enough = overlaps(truth.boxes, rows[:, 3:]) >= OVERLAP
            boxes += int(enough[linear_sum_assignment(~enough)].sum())
            together.update((truth.numbers[i], int(rows[j, 0])) for i, j in np.argwhere(inside).tolist())
        if truth.moving is not None and truth.counted is not None and number < len(report.masks):
            shown = report.masks[number] & truth.counted
            pixels += [int((shown & truth.moving).sum()), int(shown.sum()), int(truth.moving.sum())]
    pairs, known_boxes = max(1, true + reported), (clip.folder / "gt.txt").is_file()
    names, tracks = sorted({name for name, _ in together}), sorted({track for _, track in together})
    shared = np.array([[together[name, track] for track in tracks] for name in names]).reshape(len(names), len(tracks))
    return {
        "precision": right / max(1, reported),
        "recall": right / max(1, true),
        "f": 2 * right / pairs,
        "box_f": 2 * boxes / pairs if known_boxes else None,
        "idf1": 2 * float(shared[linear_sum_assignment(-shared)].sum()) / pairs if known_boxes else None,
        "count_error": away / max(1, frames),
        "mask_f": float(2 * pixels[0] / (pixels[1] + pixels[2])) if pixels[2] else None,
    }
