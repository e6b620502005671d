"""Multi-object tracking: ground truth of clips (MOT boxes or masks), what a method reports, and its scores.

A hypothesis is right if its place is inside a true box or blob.
"""

from __future__ import annotations

import functools
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from ndtorch.errors import InputError
from ndtorch.utils.files import TABLE_BYTES, read_text

Pixels = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]

MOVING, IGNORED = 200, 100
"""A mask's grey value from which on a pixel moves, and from which on it is not counted."""
SMALLEST = 0.0005
"""Smallest true blob, as a ratio of the image."""
AROUND = 3
"""Pixels around a true blob that count as inside."""
KEPT = 0.01
"""What a pair of the frame before is worth more than a new one: less than any other match."""
TRAVELLED = 1.0
"""Own sizes a true object has to go to have a main direction."""


LEVELS = np.arange(1, 20) / 20
"""Overlap ratios from which on two boxes match, of HOTA."""

Overlaps = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.float64]]
"""True identities `[K]`, tracks `[N]` and overlap ratios of every pair `[K, N]` in a frame."""


class Box(NamedTuple):
    """Left, top, right and bottom, pixels of the clip."""

    left: float
    top: float
    right: float
    bottom: float


class Hypothesis(NamedTuple):
    """One object at one frame: its track's number, its place (column and row), and its box."""

    track: int
    place: tuple[float, float]
    box: Box


class PackedMask:
    """A mask that takes little room."""

    def __init__(self, mask: Mask) -> None:
        self.shape = mask.shape
        self.bits = zlib.compress(np.packbits(mask).tobytes(), 1)

    def mask(self) -> Mask:
        """The mask as it was."""
        bits = np.frombuffer(zlib.decompress(self.bits), np.uint8)
        return np.unpackbits(bits, count=self.shape[0] * self.shape[1]).reshape(self.shape).astype(bool)


@dataclass
class TrackerOutput:
    """What a method made of a clip.

    Attributes:
        hypotheses: the objects of every frame.
        masks: what moves, of every frame; empty of methods without.
        seconds: processor time, without decoding.
    """

    hypotheses: list[list[Hypothesis]] = field(default_factory=list)
    masks: list[PackedMask] = field(default_factory=list)
    seconds: float = 0.0


class Video(NamedTuple):
    """A clip: its name, its frames `[H, W, 3]` in blue, green, red (an iterable that can be read again), frames a
    second, and height and width."""

    name: str
    frames: Any
    fps: float
    size: tuple[int, int]


class TrueObject(Protocol):
    """One true object at one frame; None of the identity where it is not known."""

    @property
    def identity(self) -> int | None: ...

    def holds(self, column: float, row: float) -> bool:
        """Whether a place is inside."""


@dataclass(frozen=True)
class TrueBox:
    """A true box."""

    identity: int | None
    box: Box

    def holds(self, column: float, row: float) -> bool:
        """Whether a place is inside."""
        return self.box.left <= column <= self.box.right and self.box.top <= row <= self.box.bottom


@dataclass(frozen=True)
class TrueBlob:
    """A connected blob of a true mask, number `label` of `labels`."""

    labels: np.ndarray[tuple[int, ...], np.dtype[np.int32]]
    label: int
    identity: int | None = None

    def holds(self, column: float, row: float) -> bool:
        """Whether a place is inside."""
        height, width = self.labels.shape
        at = (min(height - 1, max(0, int(row))), min(width - 1, max(0, int(column))))
        return bool(self.labels[at] == self.label)


@dataclass(frozen=True)
class TrueFrame:
    """The truth of one frame: its objects, and where masks are known what moves and which pixels count."""

    objects: list[TrueObject]
    moving: Mask | None = None
    counted: Mask | None = None


@dataclass(frozen=True)
class LabelledClip:
    """A clip with truth.

    Attributes:
        clip: its frames.
        truth: gives the truth, frame by frame; it may end early, after which nothing is scored.
        masked: whether the truth is masks, so that identities are not known.
    """

    clip: Video
    truth: Callable[[], Iterator[TrueFrame]]
    masked: bool = False


def nothing() -> Iterator[TrueFrame]:
    """The truth of a clip without objects."""
    return iter(())


class VideoFrames:
    """The frames of a file; every loop over them reads it again."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __iter__(self) -> Iterator[Pixels]:
        capture = cv2.VideoCapture(str(self.path))
        try:
            while True:
                there, frame = capture.read()
                if not there:
                    return
                yield np.asarray(frame, np.uint8)
        finally:
            capture.release()


def read_clip(folder: Path) -> LabelledClip:
    """The clip in a folder with `clip.mp4`, and `gt.txt` or `masks.mkv`; with neither, nothing moves in it."""
    path = folder / "clip.mp4"
    if not path.is_file():
        raise InputError(f"{folder} holds no clip.mp4")
    capture = cv2.VideoCapture(str(path))
    fps, width, height = (capture.get(k) for k in (cv2.CAP_PROP_FPS, 3, 4))
    capture.release()
    if not (fps > 0 and width and height):
        raise InputError(f"{path} is not a video that can be decoded")
    clip = Video(folder.name, VideoFrames(path), fps, (int(height), int(width)))
    if (folder / "gt.txt").exists():
        return LabelledClip(clip, functools.partial(read_boxes, folder / "gt.txt"))
    if (folder / "masks.mkv").exists():
        return LabelledClip(clip, functools.partial(read_blobs, folder / "masks.mkv", clip.size), masked=True)
    return LabelledClip(clip, nothing)


def folders_with(name: str, folder: Path, what: str) -> list[Path]:
    """The folders in a folder that hold a file of that name, or itself if it does. Raises `InputError`: none there."""
    found = [folder] if (folder / name).is_file() else sorted(path.parent for path in folder.glob(f"*/{name}"))
    if not found:
        raise InputError(f"{folder} holds no {what}")
    return found


def clip_folders(folder: Path) -> list[Path]:
    """The folders of clips in a folder, or itself if it is one."""
    return folders_with("clip.mp4", folder, "folder with a clip.mp4")


def read_boxes(path: Path) -> Iterator[TrueFrame]:
    """Frames of a file in MOT format: frame from 1, identity, left, top, width, height, and 0 for what is not to be
    counted. After its last line nothing is there, for ever.
    """
    try:
        rows = np.loadtxt(read_text(path, TABLE_BYTES).splitlines(), delimiter=",", ndmin=2)
    except InputError:
        raise
    except ValueError:
        raise InputError(f"{path} is not in MOT format: numbers between commas") from None
    if rows.size and rows.shape[1] < 6:
        raise InputError(f"{path} must have at least six columns, got {rows.shape[1]}")
    if not np.isfinite(rows).all():
        raise InputError(f"{path} must hold finite numbers")
    by_frame: dict[int, list[TrueObject]] = {}
    for row in rows.tolist():
        if len(row) < 7 or row[6]:
            box = Box(row[2], row[3], row[2] + row[4], row[3] + row[5])
            by_frame.setdefault(int(row[0]), []).append(TrueBox(int(row[1]), box))
    number = 0
    while True:
        number += 1
        yield TrueFrame(by_frame.get(number, []))


def read_blobs(path: Path, size: tuple[int, int]) -> Iterator[TrueFrame]:
    """Frames of a film of masks, their connected blobs as objects."""
    for frame in VideoFrames(path):
        grey = frame[..., 0]
        moving = grey > MOVING
        wide = cv2.dilate(moving.astype(np.uint8), np.ones((2 * AROUND + 1,) * 2, np.uint8))
        count, labels = cv2.connectedComponents(wide)
        areas = np.bincount(labels[moving], minlength=count)
        enough = SMALLEST * size[0] * size[1]
        objects: list[TrueObject] = [TrueBlob(np.asarray(labels), k) for k in range(1, count) if areas[k] >= enough]
        yield TrueFrame(objects, moving, moving | (grey < IGNORED))


@dataclass(frozen=True)
class MotScore:
    """Scores of one method on one clip; None where the truth does not know.

    Attributes:
        precision, recall, f: of places; box_f: of boxes that overlap by half of their union.
        idf1: harmonic mean of precision and recall under the best one-to-one pairing of identities.
        hota: higher order tracking accuracy (Luiten et al. 2021).
        mota: 1 - (missed + false + switches) / true.
        switches: a true object changes its track.
        fragments: times that a true object is lost and found again.
        count_error: mean absolute difference of the numbers of objects.
        direction: share of the true objects that travel whose best track has the same main direction.
        mask_f: of pixels.
        false_per_minute: tracks that begin where nothing is true, per minute of such time.
        ms_per_frame: processor time.
    """

    precision: float
    recall: float
    f: float
    box_f: float | None
    idf1: float | None
    hota: float | None
    mota: float | None
    switches: int | None
    fragments: int | None
    count_error: float
    direction: float | None
    mask_f: float | None
    false_per_minute: float | None
    ms_per_frame: float


@dataclass
class Tally:
    """Sums over frames."""

    true: int = 0
    reported: int = 0
    right: int = 0
    boxes: int = 0
    switches: int = 0
    fragments: int = 0
    away: int = 0
    frames: int = 0
    empty: int = 0


def mot_score(output: TrackerOutput, truth: Iterable[TrueFrame], fps: float, masked: bool) -> MotScore:
    """All scores of a method's hypotheses of one clip."""
    tally, together, seen = Tally(), Counter[tuple[int, int]](), list[Overlaps]()
    lasting: dict[int, int] = {}
    found_before: set[int] = set()
    paths: dict[int, list[tuple[float, float]]] = {}
    sizes: dict[int, float] = {}
    begun: set[int] = set()
    false_tracks = 0
    pixels = np.zeros(3, np.int64)
    real = iter(truth)
    empty = TrueFrame([])
    for number, hypotheses in enumerate(output.hypotheses):
        frame = next(real, empty if number == 0 or tally.empty == tally.frames else None)
        if frame is None:
            break
        tally.frames += 1
        tally.true += len(frame.objects)
        tally.reported += len(hypotheses)
        tally.away += abs(len(hypotheses) - len(frame.objects))
        pairs = match(frame.objects, hypotheses, lasting)
        tally.right += len(pairs)
        boxes = [one for one in frame.objects if isinstance(one, TrueBox)]
        shared = overlap_ratios([one.box for one in boxes], [one.box for one in hypotheses])
        tally.boxes += overlapping(shared)
        names, numbers = [one.identity for one in boxes], [one.track for one in hypotheses]
        seen.append((np.array(names, np.int64), np.array(numbers, np.int64), shared))
        if not frame.objects:
            tally.empty += 1
            false_tracks += len({hypothesis.track for hypothesis in hypotheses} - begun)
        begun |= {hypothesis.track for hypothesis in hypotheses}
        for obj in frame.objects:
            if isinstance(obj, TrueBox) and obj.identity is not None:
                box = obj.box
                paths.setdefault(obj.identity, []).append(((box.left + box.right) / 2, (box.top + box.bottom) / 2))
                sizes[obj.identity] = max(sizes.get(obj.identity, 0.0), box.right - box.left)
        for i, j in pairs:
            name, track = frame.objects[i].identity, hypotheses[j].track
            if name is None:
                continue
            tally.switches += lasting.get(name, track) != track
            tally.fragments += name in lasting and name not in found_before
            lasting[name] = track
        found_before = {name for i, _ in pairs if (name := frame.objects[i].identity) is not None}
        for obj in frame.objects:
            for hypothesis in hypotheses:
                if obj.identity is not None and obj.holds(*hypothesis.place):
                    together[obj.identity, hypothesis.track] += 1
        if frame.moving is not None and frame.counted is not None and number < len(output.masks):
            reported = output.masks[number].mask() & frame.counted
            pixels += [int((reported & frame.moving).sum()), int(reported.sum()), int(frame.moving.sum())]
    best = identities(together)
    missed, false = tally.true - tally.right, tally.reported - tally.right
    known = not masked and tally.true > 0
    return MotScore(
        precision=tally.right / max(1, tally.reported),
        recall=tally.right / max(1, tally.true),
        f=2 * tally.right / max(1, tally.reported + tally.true),
        box_f=2 * tally.boxes / max(1, tally.reported + tally.true) if known else None,
        idf1=2 * sum(together[pair] for pair in best.items()) / max(1, tally.reported + tally.true) if known else None,
        hota=hota(seen) if known else None,
        mota=1 - (missed + false + tally.switches) / tally.true if known else None,
        switches=tally.switches if known else None,
        fragments=tally.fragments if known else None,
        count_error=tally.away / max(1, tally.frames),
        direction=directions(output, paths, sizes, best) if known else None,
        mask_f=float(2 * pixels[0] / max(1, pixels[1] + pixels[2])) if pixels[2] and output.masks else None,
        false_per_minute=false_tracks / (tally.empty / fps / 60) if tally.empty else None,
        ms_per_frame=1000 * output.seconds / max(1, len(output.hypotheses)),
    )


def match(objects: list[TrueObject], hypotheses: list[Hypothesis], before: dict[int, int]) -> list[tuple[int, int]]:
    """As many pairs as can be of true objects and hypotheses inside them, those of the frame before preferred."""
    if not objects or not hypotheses:
        return []
    worth = np.zeros((len(objects), len(hypotheses)))
    for i, obj in enumerate(objects):
        for j, hypothesis in enumerate(hypotheses):
            if obj.holds(*hypothesis.place):
                kept = obj.identity is not None and before.get(obj.identity) == hypothesis.track
                worth[i, j] = 1 + KEPT * kept
    rows, columns = linear_sum_assignment(-worth)
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if worth[i, j] > 0]


def overlap_ratios(true: Sequence[Box], reported: Sequence[Box]) -> npt.NDArray[np.float64]:
    """Intersection over union of every pair, `[K, N]`."""
    one, other = (np.array(boxes, np.float64).reshape(-1, 4) for boxes in (true, reported))
    common = np.minimum(one[:, None, 2:], other[None, :, 2:]) - np.maximum(one[:, None, :2], other[None, :, :2])
    shared = common.clip(0).prod(-1)
    areas = [(boxes[:, 2:] - boxes[:, :2]).prod(-1) for boxes in (one, other)]
    return np.asarray(shared / np.maximum(areas[0][:, None] + areas[1] - shared, 1e-9))


def mask_iou(one: Mask, other: Mask) -> float:
    """Intersection over union of two masks."""
    return float((one & other).sum() / max(1, (one | other).sum()))


def overlapping(ratios: npt.NDArray[np.float64]) -> int:
    """How many true boxes have one of their own that overlaps them by half of their union."""
    enough = ratios >= 0.5
    rows, columns = linear_sum_assignment(-enough.astype(float))
    return int(enough[rows, columns].sum())


def hota(frames: Sequence[Overlaps]) -> float:
    """HOTA (Luiten et al., IJCV 2021): the root of detection times association accuracy, mean over `LEVELS`.

    Each frame is matched once, by overlap times the overlap that two identities share in all frames.
    """
    names, numbers = (np.unique(np.concatenate(column)) for column in list(zip(*frames, strict=True))[:2])
    places = [(np.searchsorted(names, n), np.searchsorted(numbers, m), ratios) for n, m, ratios in frames]
    either = np.zeros((len(names), len(numbers)))
    shared, matched = either.copy(), np.zeros((len(LEVELS), *either.shape))
    for i, j, ratios in places:
        either[i] += 1
        either[:, j] += 1
        shared[np.ix_(i, j)] += ratios / np.maximum(ratios.sum(0) + ratios.sum(1)[:, None] - ratios, 1e-9)
    likely = shared / (either - shared)
    for i, j, ratios in places:
        a, b = linear_sum_assignment(-likely[np.ix_(i, j)] * ratios)
        matched[:, i[a], j[b]] += ratios[a, b] >= LEVELS[:, None] - 1e-9
    right, pairs = matched.sum((1, 2)), sum(len(i) + len(j) for i, j, _ in places)
    detection, associated = right / (pairs - right), (matched**2 / (either - matched)).sum((1, 2))
    return float(np.sqrt(detection * associated / np.maximum(right, 1)).mean())


def identities(together: Counter[tuple[int, int]]) -> dict[int, int]:
    """The pairing of true identities and tracks that shares most frames."""
    names, tracks = sorted({name for name, _ in together}), sorted({track for _, track in together})
    shared = np.array([[together[name, track] for track in tracks] for name in names]).reshape(len(names), len(tracks))
    rows, columns = linear_sum_assignment(-shared)
    return {names[i]: tracks[j] for i, j in zip(rows, columns, strict=True) if shared[i, j] > 0}


def directions(
    output: TrackerOutput, paths: dict[int, list[tuple[float, float]]], sizes: dict[int, float], best: dict[int, int]
) -> float | None:
    """Share of the true objects that travel whose track has the same main direction; None where none does."""
    reported: dict[int, list[tuple[float, float]]] = {}
    for hypotheses in output.hypotheses:
        for hypothesis in hypotheses:
            reported.setdefault(hypothesis.track, []).append(hypothesis.place)
    right = [
        name in best and direction(reported[best[name]]) == direction(path)
        for name, path in paths.items()
        if max(abs(path[-1][k] - path[0][k]) for k in (0, 1)) >= TRAVELLED * sizes[name]
    ]
    return float(np.mean(right)) if right else None


def direction(path: list[tuple[float, float]]) -> str:
    """left, right, up or down, from the first place of a path to its last."""
    across, down = path[-1][0] - path[0][0], path[-1][1] - path[0][1]
    if abs(across) >= abs(down):
        return "right" if across > 0 else "left"
    return "down" if down > 0 else "up"
