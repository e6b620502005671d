"""`ndtorch benchmark foreground`: models for video, and background subtraction with trackers of boxes, on clips."""

from __future__ import annotations

import functools
import platform
import time
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
import torch

import ndtorch
from ndtorch.errors import InputError
from ndtorch.loading import model_kind
from ndtorch.report.page import Shown
from ndtorch.run.opening import CAMERA_MODELS
from ndtorch.scenes.video import reduced
from ndtorch.utils.packages import MODELS, need
from ndtorch_train.benchmark.base import Benchmark, Column, Split, Task, known
from ndtorch_train.benchmark.dish_clips import DISHES, dish_clip
from ndtorch_train.benchmark.generated_clips import boxes_of, clip_file, draw_clip
from ndtorch_train.benchmark.mot import (
    SMALLEST,
    Box,
    Hypothesis,
    LabelledClip,
    Mask,
    PackedMask,
    Pixels,
    TrackerOutput,
    Video,
    VideoFrames,
    clip_folders,
    mot_score,
    nothing,
    read_clip,
)
from ndtorch_train.benchmark.negative_clips import FPS, KINDS, SEEDS, Drawn, still_image
from ndtorch_train.benchmark.street_clips import STREETS, street_clip
from ndtorch_train.plots import draw_table
from ndtorch_train.rows import Row

OPENING = 3
"""Pixels of the square with which masks are opened."""


class Tuning(NamedTuple):
    """Side of the square with which masks are closed, pixels, 0 for none, and smallest area, share of the image."""

    closing: int
    area: float


SUBTRACTORS = {
    "mog2": Tuning(0, SMALLEST),
    "knn": Tuning(0, SMALLEST),
    "gsoc": Tuning(5, 0.0015),
    "lsbp": Tuning(5, 0.0015),
    "cnt": Tuning(5, 0.0015),
}
"""Background subtraction of OpenCV with its defaults, the last three of its contributed modules. None is tuned."""
REACH = 1.0
"""Norfair: largest distance of a detection from where a track is expected, in sizes of the box."""

COLUMNS = (
    Column("clip", "clip"),
    Column("method", "method"),
    Column("precision", "precision", better=1),
    Column("recall", "recall", better=1),
    Column("f", "F", better=1),
    Column("box_f", "F of boxes", better=1),
    Column("idf1", "IDF1", better=1),
    Column("hota", "HOTA", better=1),
    Column("mota", "MOTA", better=1),
    Column("switches", "switches", better=-1),
    Column("count_error", "count error", better=-1),
    Column("mask_f", "mask F", better=1),
    Column("ms_per_frame", "ms a frame", better=-1),
    Column("fragments", "fragments", better=-1),
    Column("direction", "direction", better=1),
    Column("false_per_minute", "false a minute", better=-1),
    Column("times_mog2", "times MOG2", better=-1),
)

NOTE = (
    "A place is right inside a true box or blob. Processor time of one thread, without decoding, and its ratio to MOG2 "
    "with its contours alone in the same process. Masks and counts over all frames. The model reports an object from "
    "its first detection on, once it is known to be one; the peers report it when they know. "
    f"{platform.machine()}, torch {torch.__version__}."
)

TRACKERS = {"norfair": "", "sort": "SORTTracker", "bytetrack": "ByteTrackTracker", "ocsort": "OCSORTTracker"}
"""Trackers of boxes: Norfair, and classes of the package trackers."""
METHODS = ("foreground", *(f"{kind}-{tracker}" for kind in SUBTRACTORS for tracker in TRACKERS))
"""The model for video, and background subtraction with a tracker of boxes."""

USES = ("ndtorch.vision", "ndtorch.scenes", "ndtorch.binding", "ndtorch.loading", MODELS)


class Generated(NamedTuple):
    """Generated clips: how many of each number of objects and frame rate, and the folder that keeps them."""

    clips: int
    counts: Sequence[int]
    fps: Sequence[float]
    keep: Path | None


def foreground_benchmark(
    methods: Sequence[str],
    rows: int,
    split: Split,
    folder: Path | None = None,
    generated: Generated | None = None,
    negative: tuple[Path, float] | None = None,
    streets: bool = False,
    dishes: bool = False,
) -> Benchmark:
    """The benchmark of some methods on labelled, generated and negative clips."""
    known("methods", [name for name in methods if not Path(name).is_dir()] or METHODS, METHODS)
    if rows != 0 and rows < 32:
        raise InputError(f"rows must be 0 or at least 32, got {rows}")
    clips: dict[str, Callable[[Path], LabelledClip]] = {}
    if folder is not None:
        for place in clip_folders(folder):
            read_clip(place)
            clips[place.name] = functools.partial(labelled_clip, place)
    if generated is not None:
        check_generated(generated)
        for number, fps, count in product(range(generated.clips), generated.fps, generated.counts):
            make = functools.partial(generated_clip, split, number, count, fps, generated.keep)
            clips[f"{count} objects, {fps:g}/s, {number}"] = make
    if negative is not None:
        if not 1 <= negative[1] <= 3600:
            raise InputError(f"negative-seconds must lie between 1 and 3600, got {negative[1]:g}")
        still = still_image(negative[0])
        for kind in KINDS:
            clips[kind] = functools.partial(negative_clip, kind, still, negative[1], split)
    for kind in STREETS if streets else ():
        clips[kind] = functools.partial(drawn_clip, kind, split)
    for kind in DISHES if dishes else ():
        clips[kind] = functools.partial(dish_in, kind, split)
    if not clips:
        raise InputError("name a folder of clips, or give --streets, --dishes, --generated N or --negative IMAGE")
    tasks = [
        Task(f"{clip}, {method}", functools.partial(measure, method, clip, make, rows))
        for clip, make in clips.items()
        for method in methods
    ]
    settings = {"folder": str(folder), "rows": rows, "split": split, "negative": str(negative)}
    title = "Objects in video with ground truth"
    return Benchmark("foreground", title, NOTE, COLUMNS, tasks, USES, mean_rows, draw, settings=settings)


def check_generated(options: Generated) -> None:
    """Check the options of generated clips. Raises `InputError`: numbers out of range."""
    if not 1 <= options.clips <= 100_000:
        raise InputError(f"generated must be between 1 and 100000, got {options.clips}")
    if any(not 0 <= count <= 4 for count in options.counts):
        raise InputError(f"counts must lie between 0 and 4, got {options.counts}")
    if any(not 1 <= fps <= 240 for fps in options.fps):
        raise InputError(f"fps must lie between 1 and 240 frames a second, got {options.fps}")


def labelled_clip(place: Path, out: Path) -> LabelledClip:
    """The clip of a folder."""
    return read_clip(place)


def generated_clip(split: Split, number: int, count: int, fps: float, keep: Path | None, out: Path) -> LabelledClip:
    """A generated clip as an encoded file in the folder `keep`, or in `clips` of the benchmark's folder."""
    clip, folder = draw_clip(split, number, count, fps), keep or out / "clips"
    folder.mkdir(parents=True, exist_ok=True)
    frames = VideoFrames(clip_file(clip, folder))
    return LabelledClip(Video(clip.name, frames, fps, clip.size), functools.partial(boxes_of, clip))


def negative_clip(kind: str, still: Pixels, seconds: float, split: Split, out: Path | None = None) -> LabelledClip:
    """A clip of one kind of disturbance over a still image."""
    frames = Drawn(kind, still, SEEDS[split], round(seconds * FPS))
    return LabelledClip(Video(kind, frames, FPS, still.shape[:2]), nothing)


def drawn_clip(kind: str, split: Split, out: Path) -> LabelledClip:
    """A street clip, which needs no folder."""
    return street_clip(kind, split)


def dish_in(kind: str, split: Split, out: Path) -> LabelledClip:
    """A dish as an encoded file in `clips` of the benchmark's folder."""
    return dish_clip(kind, split, out / "clips")


def measure(method: str, name: str, make: Callable[[Path], LabelledClip], rows: int, folder: Path) -> list[Row]:
    """The row of one method on one clip."""
    labelled = make(folder)
    output = run_method(method, labelled.clip, rows)
    score = mot_score(output, labelled.truth(), labelled.clip.fps, labelled.masked)
    ratio = output.seconds / max(mog2_seconds(labelled.clip, rows), 1e-9)
    return [{"clip": name, "method": method, **asdict(score), "times_mog2": ratio}]


def mean_rows(rows: list[Row]) -> list[Row]:
    """The mean of every method over all clips."""
    if len({row["clip"] for row in rows}) < 2:
        return []
    found = []
    for method in dict.fromkeys(row["method"] for row in rows):
        mine = [row for row in rows if row["method"] == method]
        values = {c.key: [float(v) for row in mine if (v := row[c.key]) is not None] for c in COLUMNS[2:]}
        means = {key: float(np.mean(each)) if each else None for key, each in values.items()}
        found.append({"clip": "mean", "method": method, **means})
    return found


def draw(rows: list[Row], folder: Path) -> list[Shown]:
    """F, IDF1 and false objects of every method on every clip."""
    metrics = [("f", "F"), ("idf1", "IDF1"), ("mask_f", "mask F"), ("false_per_minute", "false a minute")]
    return draw_table(rows, folder, "foreground", "clip", metrics)


def run_method(method: str, clip: Video, rows: int = 0) -> TrackerOutput:
    """Run a method, one of `METHODS` or a model folder, over a clip; `rows`: height of its frames, 0 for their own."""
    kind, _, tracker = method.partition("-")
    if tracker in TRACKERS:
        return run_peer(kind, Norfair(clip.fps) if tracker == "norfair" else Peer(tracker, clip.fps), clip, rows)
    return run_model(method, clip, rows)


def scaled_frames(clip: Video, rows: int) -> Iterator[Pixels]:
    """The frames at that height."""
    size = (rows, max(8, round(rows * clip.size[1] / clip.size[0] / 8) * 8))
    for frame in clip.frames:
        yield reduced(frame, size) if rows else frame


def mog2_seconds(clip: Video, rows: int) -> float:
    """Processor time of MOG2 and its contours over a clip."""
    subtract, seconds = Subtraction("mog2"), 0.0
    for frame in scaled_frames(clip, rows):
        began = time.process_time()
        subtract(frame)
        seconds += time.process_time() - began
    return seconds


def run_peer(kind: str, tracker: BoxTracker, clip: Video, rows: int) -> TrackerOutput:
    """Background subtraction and a tracker of boxes."""
    subtract, output = Subtraction(kind), TrackerOutput()
    height, width = clip.size
    for frame in scaled_frames(clip, rows):
        began = time.process_time()
        mask, boxes = subtract(frame)
        hypotheses = tracker(boxes)
        output.seconds += time.process_time() - began
        across, down = width / frame.shape[1], height / frame.shape[0]
        output.hypotheses.append([scaled(one, across, down) for one in hypotheses])
        wide = mask.astype(np.uint8)
        if wide.shape != clip.size:
            wide = np.asarray(cv2.resize(wide, (width, height), interpolation=cv2.INTER_NEAREST), np.uint8)
        output.masks.append(PackedMask(wide > 0))
    return output


def scaled(one: Hypothesis, across: float, down: float) -> Hypothesis:
    """A hypothesis in pixels of the clip."""
    box = Box(one.box.left * across, one.box.top * down, one.box.right * across, one.box.bottom * down)
    return Hypothesis(one.track, (one.place[0] * across, one.place[1] * down), box)


def run_model(name: str, clip: Video, rows: int, options: Mapping[str, Any] | None = None) -> TrackerOutput:
    """A model with tracks, with other constants: objects count from their first detection on, once they are known."""
    output = TrackerOutput()
    # As `ndtorch bind` gives them.
    most = CAMERA_MODELS.get(model_kind(name), clip.size[0])
    frames = list(scaled_frames(clip, min(rows or clip.size[0], most)))
    height, width = frames[0].shape[:2]
    model, state = ndtorch.load(name, size=(height, width), fps=clip.fps, **(options or {})), None
    shapes: list[Any] = []
    with torch.inference_mode():
        for start in range(0, len(frames), 8):
            chunk = np.stack([frame[..., ::-1] for frame in frames[start : start + 8]])
            began = time.process_time()
            signals, state = model(torch.from_numpy(chunk).permute(0, 3, 1, 2), state)
            output.seconds += time.process_time() - began
            if hasattr(signals, "labels"):
                shapes += [zlib.compress(one.numpy().tobytes(), 1) for one in signals.labels]
                form = tuple(signals.labels.shape[1:])
        objects = model.objects(state)
    across, down = clip.size[1] / width, clip.size[0] / height
    output.hypotheses = [[] for _ in frames]
    for obj in objects:
        for k, (at, column, row) in enumerate(obj.path):
            box = Box(*obj.boxes[k]) if obj.boxes else Box(column, row, column, row)
            one = Hypothesis(obj.track or 0, (column, row), box)
            output.hypotheses[round(at * clip.fps)].append(scaled(one, across, down))
    confirmed = [(obj.track or 0) + 1 for obj in objects]
    for packed in shapes:
        labels = np.frombuffer(zlib.decompress(packed), np.int32).reshape(form)
        image = np.isin(labels, confirmed).astype(np.uint8) * 255
        wide = cv2.resize(image, clip.size[::-1], interpolation=cv2.INTER_LINEAR)
        output.masks.append(PackedMask(np.asarray(wide) > 127))
    return output


class Subtraction:
    """Background subtraction as it comes, opening with a small square, closing, contours of a smallest area.

    Args:
        kind: one of `SUBTRACTORS`.

    Raises:
        InputError: OpenCV comes without its contributed modules.
    """

    def __init__(self, kind: str) -> None:
        name, self.tuning = f"createBackgroundSubtractor{kind.upper()}", SUBTRACTORS[kind]
        create = getattr(cv2, name, None) or getattr(getattr(cv2, "bgsegm", None), name, None)
        if create is None:
            raise InputError(f"the method {kind} needs the package opencv-contrib-python-headless in place of OpenCV's")
        self.model: Any = create()

    def __call__(self, frame: Pixels) -> tuple[Mask, list[Box]]:
        """The mask, shadows left out, and its boxes."""
        mask = (self.model.apply(frame) == 255).astype(np.uint8)
        for kind, side in ((cv2.MORPH_OPEN, OPENING), (cv2.MORPH_CLOSE, self.tuning.closing)):
            if side:
                mask = np.asarray(cv2.morphologyEx(mask, kind, np.ones((side, side), np.uint8)), np.uint8)
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        found = []
        for contour in contours:
            if cv2.contourArea(contour) >= self.tuning.area * mask.size:
                left, top, width, height = cv2.boundingRect(contour)
                found.append(Box(left, top, left + width, top + height))
        return mask > 0, found


class BoxTracker(Protocol):
    """Boxes of one frame after the other -> boxes with identities."""

    def __call__(self, boxes: Sequence[Box]) -> list[Hypothesis]: ...


class Norfair:
    """Norfair's tracker over centers, distance in sizes of the box; reports only tracks detected in this very frame."""

    def __init__(self, fps: float) -> None:
        self.norfair = need("norfair", "the method norfair")

        def distance(seen: Any, track: Any) -> float:
            return float(np.linalg.norm(seen.points[0] - track.estimate[0]) / seen.data[1])

        # A track is kept for half a second.
        self.tracker = self.norfair.Tracker(distance, REACH, hit_counter_max=max(2, round(fps / 2)))

    def __call__(self, boxes: Sequence[Box]) -> list[Hypothesis]:
        sizes = [max(box.right - box.left, box.bottom - box.top) for box in boxes]
        detect = self.norfair.Detection
        seen = [detect(np.array([middle(b)]), data=(b, size)) for b, size in zip(boxes, sizes, strict=True)]
        tracks = self.tracker.update(seen)
        # Norfair copies detections, but not what they carry.
        now = {id(one.data) for one in seen}
        out = []
        for track in tracks:
            if id(track.last_detection.data) in now and track.id is not None:
                box = track.last_detection.data[0]
                out.append(Hypothesis(int(track.id), middle(box), box))
        return out


class Peer:
    """A tracker of the package trackers, with its defaults."""

    def __init__(self, name: str, fps: float) -> None:
        self.detections = need("supervision", f"the method {name}").Detections
        self.tracker = getattr(need("trackers", f"the method {name}"), TRACKERS[name])(frame_rate=fps)

    def __call__(self, boxes: Sequence[Box]) -> list[Hypothesis]:
        places, sure = np.array(boxes, np.float64).reshape(-1, 4), np.ones(len(boxes), np.float32)
        found = self.tracker.update(self.detections(places, confidence=sure, class_id=np.zeros(len(boxes), int)))
        # Tracks that are not confirmed have the number -1.
        pairs = [] if found.tracker_id is None else zip(found.tracker_id.tolist(), found.xyxy.tolist(), strict=True)
        rows = [(int(number), Box(*row)) for number, row in pairs if number >= 0]
        return [Hypothesis(number, middle(box), box) for number, box in rows]


def middle(box: Box) -> tuple[float, float]:
    """Column and row of a box's middle."""
    return (box.left + box.right) / 2, (box.top + box.bottom) / 2
