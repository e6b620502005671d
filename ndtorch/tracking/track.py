"""Tracks and their life cycle: tentative, confirmed, stationary, lost; how they end and become background."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from ndtorch.foreground.arrays import Floats, Numbers
from ndtorch.tracking.params import TrackingParams

DETECTION = 10
"""Numbers kept of every detection: time, row and column of its middle, top, left, bottom and right, pixels, and row and
column by which it is followed."""
BOX, PIXELS, PLACE = slice(3, 7), 7, slice(8, 10)
MAX_PATH = 2048
"""A track keeps fewer detections than this: the earlier half of so many is closed."""
MAX_WAITED_S = 600.0
"""What stood from the first frame on is reported for at most so many seconds before it left."""
PATCH = 12
"""Rows and columns of the kept appearance of a track."""
Pair = Sequence[float]
"""Two plain numbers, as of rows and columns: with arrays of two every sum takes several times as long."""
MOVED_SIZES = 0.5
"""A track has moved on if it is this many sizes from its anchor."""

QUIET_S, PARKED_S = 10.0, 30.0
"""Once an object is stationary for so many seconds the noise under it is not learned, or it would hide it; and it is
parked: what covers it passes, and does not take it along."""


class TrackState(IntEnum):
    """Life cycle of a track. CONFIRMED, STATIONARY and LOST tracks are objects; TENTATIVE ones are not, or no more."""

    TENTATIVE = 0
    CONFIRMED = 1
    STATIONARY = 2
    LOST = 3


class TrackTable(NamedTuple):
    """N tracks as arrays, or as tensors in the state of a model. N and P depend on the run.

    Attributes:
        number: in the order in which they began, `[N]` int64.
        state: a `TrackState`, `[N]` int64.
        velocity: rows and columns (fractions of the height) a second, `[N, 2]` float64.
        extent: followed height and width, fractions of the height, `[N, 2]`.
        color: followed color, `[N, 3]`.
        start: place at which it began, `[N, 2]`; last_moved: time at which it last moved on, `[N]`.
        anchor: place at that time, `[N, 2]`.
        inputs, outputs: of the network, sums over its detections, `[N, 10]`.
        shades: shares of white, grey, black and hues, sums over its detections, `[N, 4]`.
        patch_box: box in which its appearance was kept, fractions of the height, and patch: that appearance, less the
            background, `[N, 4]` and `[N, 3, PATCH, PATCH]` float32.
        appearance_error: sums of squared differences between that and its old place later, and its new place,
            `[N, 2]`.
        contrast_sum: contrast in deviations of the noise, and shadow_sum: share that may be a narrow shadow, sums over
            the detections of tentative tracks, `[N]` float64.
        confirmed_at: time at which it was first confirmed, -1 before, `[N]` float64.
        passed_at: time at which an object had been where it began, `[N]` float64.
        waited: the detection that its ghost stands for: from that time on it stood where the ghost is; without pixels
            if there is none, `[N, 10]`.
        length: detections of every track, `[N]` int64.
        path: all their detections, track after track, `[P, 10]`, see `DETECTION`.
    """

    number: Any
    state: Any
    velocity: Any
    extent: Any
    color: Any
    start: Any
    last_moved: Any
    anchor: Any
    inputs: Any
    outputs: Any
    shades: Any
    patch_box: Any
    patch: Any
    appearance_error: Any
    contrast_sum: Any
    shadow_sum: Any
    confirmed_at: Any
    passed_at: Any
    waited: Any
    length: Any
    path: Any


class Rows(NamedTuple):
    """A table of the tracker, `[N, K]` float64; N depends on the run."""

    rows: Any


@dataclass
class Track:
    """One track: the attributes are those of `TrackTable`; its path is `detections` and then `new_detections`."""

    number: int
    state: TrackState
    velocity: Pair
    extent: Pair
    color: Numbers
    start: Pair
    last_moved: float
    anchor: Pair
    inputs: Numbers
    outputs: Numbers
    shades: Numbers
    patch_box: Numbers
    patch: Floats
    appearance_error: Pair
    contrast_sum: float
    shadow_sum: float
    confirmed_at: float
    passed_at: float
    waited: Numbers
    detections: Numbers
    new_detections: list[tuple[float, ...]] = field(default_factory=list)

    @classmethod
    def begin(cls, number: int, time: float, place: Pair) -> Track:
        """A tentative track without detections."""
        two, ten, blank = (0.0, 0.0), np.zeros(10), np.zeros((3, PATCH, PATCH), np.float32)
        sums = (ten, ten, np.zeros(4), np.zeros(4), blank, two, 0.0, 0.0, -1.0, time, np.zeros(DETECTION))
        none = np.zeros((0, DETECTION))
        return cls(number, TrackState.TENTATIVE, two, two, np.zeros(3), place, time, place, *sums, none)

    def restart(self, time: float, place: Pair) -> None:
        """Forget everything but the number."""
        vars(self).update(vars(Track.begin(self.number, time, place)))

    def close_earlier(self) -> Track | None:
        """Forget the earlier half of a path of `MAX_PATH` detections; returns it as a track of this number."""
        if self.count < MAX_PATH:
            return None
        path, ten, waited = self.path, np.zeros(10), self.waited
        self.detections, self.new_detections, self.waited = path[MAX_PATH // 2 :].copy(), [], np.zeros(DETECTION)
        earlier = path[: MAX_PATH // 2]
        return replace(self, inputs=ten, outputs=ten, waited=waited, detections=earlier, new_detections=[])

    def before(self, dt: float) -> list[list[float]]:
        """Detections, `dt` seconds apart, for the time for which it waited, at most `MAX_WAITED_S`."""
        if not self.waited[PIXELS]:
            return []
        steps = int(min(self.first_seen - self.waited[0] + dt / 2, MAX_WAITED_S) / dt)
        return [[self.first_seen - n * dt, *self.waited[1:].tolist()] for n in range(steps, 0, -1)]

    @property
    def is_object(self) -> bool:
        """Whether it is confirmed."""
        return self.state != TrackState.TENTATIVE

    @property
    def count(self) -> int:
        """Number of its detections."""
        return len(self.detections) + len(self.new_detections)

    @property
    def path(self) -> Numbers:
        """All detections, `[n, 10]`."""
        if not self.new_detections:
            return self.detections
        return np.concatenate([self.detections, np.array(self.new_detections).reshape(-1, DETECTION)])

    @property
    def last(self) -> tuple[float, ...]:
        """The latest detection."""
        return self.new_detections[-1] if self.new_detections else tuple(self.detections[-1].tolist())

    @property
    def first(self) -> Sequence[float]:
        """The first detection."""
        return self.detections[0] if len(self.detections) else self.new_detections[0]

    @property
    def first_seen(self) -> float:
        """Seconds since the first frame."""
        return float(self.first[0])

    @property
    def last_seen(self) -> float:
        return self.last[0]

    @property
    def age(self) -> float:
        """Seconds from the first to the latest detection."""
        return self.last_seen - self.first_seen

    @property
    def size(self) -> float:
        """Mean of height and width."""
        return (self.extent[0] + self.extent[1]) / 2

    @property
    def net_travel(self) -> float:
        """Distance from where it began."""
        return math.dist(self.last[PLACE], self.start)

    def expected(self, time: float, most: float) -> tuple[float, float]:
        """Predicted row and column; the prediction goes on for `most` seconds after the latest detection."""
        last, (down, across) = self.last, self.velocity
        gap = min(time - last[0], most)
        return last[8] + down * gap, last[9] + across * gap

    def box(self, time: float, most: float) -> tuple[float, float, float, float]:
        """Predicted top, left, bottom and right, as `expected`."""
        (row, column), (tall, wide) = self.expected(time, most), self.extent
        return row - tall / 2, column - wide / 2, row + tall / 2, column + wide / 2


def max_missed_time(track: Track, dt: float, p: TrackingParams) -> float:
    """Seconds without a detection after which a track ends.

    A tentative track is not waited for longer than it was in sight, and every track until the next frame, `dt` later,
    may show it.
    """
    wanted = p.max_lost_s if track.is_object else min(p.max_lost_s, max(p.min_track_s, track.age))
    return max(wanted, 1.5 * dt)


def split_lost(tracks: Sequence[Track], time: float, dt: float, p: TrackingParams) -> tuple[list[Track], list[Track]]:
    """The tracks that go on, and those that end because they were not detected for too long."""
    kept, lost = list[Track](), list[Track]()
    for track in tracks:
        (lost if time - track.last_seen > max_missed_time(track, dt, p) else kept).append(track)
    return kept, lost


def update_stationary(tracks: Sequence[Track], time: float, p: TrackingParams) -> None:
    """An object that did not move on for `stationary_after_s` is STATIONARY until it does."""
    for track in tracks:
        if track.is_object:
            still = time - track.last_moved >= p.stationary_after_s
            track.state = TrackState.STATIONARY if still else TrackState.CONFIRMED


def stands(track: Track, time: float, seconds: float) -> bool:
    """Whether an object has been stationary for longer than that."""
    return track.state == TrackState.STATIONARY and time - track.last_moved > seconds


def is_kept_from_background(track: Track, time: float, width: float, p: TrackingParams) -> bool:
    """Whether the background is not learned under a track.

    A stationary object becomes background after `stationary_max_s`, a tentative track after `tentative_max_s`. Under
    small tentative tracks the background learns at once that leaves and water flicker. `width` is that of the image in
    heights.
    """
    if track.is_object:
        return time - track.last_moved < p.stationary_max_s
    return time - track.first_seen < p.tentative_max_s and not is_small(track, width, p)


def is_small(track: Track, width: float, p: TrackingParams) -> bool:
    """Whether a track never had a blob of `min_area_ratio`, in an image so many heights wide."""
    least = p.min_area_ratio * width
    return track.last[PIXELS] < least and bool(track.path[:, PIXELS].max() < least)


def tracks_from_table(table: TrackTable) -> list[Track]:
    """The tracks of a table. They share its memory and never write to it."""
    arrays = [np.asarray(column) for column in table]
    *columns, length, path = arrays
    paths = np.split(path, np.cumsum(length)[:-1]) if len(length) else []
    lists = [column.tolist() if column.shape[1:] in ((), (2,)) else list(column) for column in columns]
    lists[1] = list(map(TrackState, lists[1]))
    # The latest detections are asked for all the time.
    latest = [list(map(tuple, path[-1:].tolist())) for path in paths]
    return [Track(*row) for row in zip(*lists, [path[:-1] for path in paths], latest, strict=True)]


def table_from_tracks(tracks: Sequence[Track]) -> TrackTable:
    """Tracks as arrays."""

    def stacked(name: str, *shape: int) -> Numbers:
        rows = [getattr(track, name) for track in tracks]
        return np.array(rows) if rows else np.zeros((0, *shape))

    def numbers(name: str, kind: type = np.float64) -> Any:
        return np.array([getattr(track, name) for track in tracks], kind)

    paths = [track.path for track in tracks]
    return TrackTable(
        number=numbers("number", np.int64),
        state=numbers("state", np.int64),
        velocity=stacked("velocity", 2),
        extent=stacked("extent", 2),
        color=stacked("color", 3),
        start=stacked("start", 2),
        last_moved=numbers("last_moved"),
        anchor=stacked("anchor", 2),
        inputs=stacked("inputs", 10),
        outputs=stacked("outputs", 10),
        shades=stacked("shades", 4),
        patch_box=stacked("patch_box", 4),
        patch=stacked("patch", 3, PATCH, PATCH).astype(np.float32),
        appearance_error=stacked("appearance_error", 2),
        contrast_sum=numbers("contrast_sum"),
        shadow_sum=numbers("shadow_sum"),
        confirmed_at=numbers("confirmed_at"),
        passed_at=numbers("passed_at"),
        waited=stacked("waited", DETECTION),
        length=np.array([len(path) for path in paths], np.int64),
        path=np.concatenate(paths) if paths else np.zeros((0, DETECTION)),
    )


def joined_parts(tracks: Sequence[Track]) -> list[Track]:
    """The tracks in the order of their numbers, each with the parts of its path, which follow one another, joined."""
    parts: dict[int, list[Track]] = {}
    for one in tracks:
        parts.setdefault(one.number, []).append(one)
    for number, (*earlier, last) in parts.items():
        path = np.concatenate([one.path for one in (*earlier, last)])
        waited = (*earlier, last)[0].waited
        parts[number] = [replace(last, waited=waited, detections=path, new_detections=[])]
    return [parts[number][0] for number in sorted(parts)]
