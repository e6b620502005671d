"""Tracks of the blobs of a foreground mask: constant velocity and one assignment, as SORT (Bewley et al. 2016), with
confirmation by travel, stationary objects and ghosts.

Lengths are fractions of the image height; a *size* is the mean of an object's height and width.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.config import Constants, constant
from ndtorch.foreground import _kernels
from ndtorch.foreground._kernels import (
    confirm_tracks,
    count_inside,
    fill_costs,
    look_up,
    mark_static,
    measure_tracks,
    name_blobs,
    sum_blobs,
)
from ndtorch.foreground.background import SQUARE, BackgroundState, Bytes, Labels, Numbers, Segmentation, is_ghost
from ndtorch.utils.tensors import safe_state

Bools = npt.NDArray[np.bool_]
Whole = npt.NDArray[np.int64]

TAU_VELOCITY_S, TAU_SIZE_S = 0.4, 0.4
"""Time constants of velocity, size and color of a track."""
MAX_PREDICTION_S, GATE_GROWTH = 0.5, 1.0
"""A track is predicted at its velocity for so long, and its gate grows by this share a second."""
CLOSING = 0.01
"""Gaps in a blob up to about this fraction of the height are closed."""
CLAIM, INSIDE = 0.25, 0.6
"""A confirmed track claims the blob that covers most of its expected box if they share this fraction of the smaller;
another blob with this fraction inside that box is a fragment of it."""
FRAGMENT_AREA = 2.5
"""A blob beside one of so many times its area is a fragment of it, and begins no track."""
MAX_AREA_RATIO = 4.0
"""Areas of two detections of a track differ by at most this ratio, unless they overlap."""
SHARED_GAIN = 0.3
"""In a shared blob this share of the innovation is taken into the position."""
MAX_SHARED = 2.0
"""A track that shared blobs in more than so many times the detections in which it was alone was a fragment: it claims
no part of the blob of another."""
MOVED_SIZES, MIN_TRAVEL = 0.5, 0.05
"""An object moves on by so many sizes; the travel that confirms it is at least this fraction of the height."""
TENTATIVE_S, STARTING_S = 1.0, 1.0
"""Tentative tracks become background after this many seconds; none is confirmed within so many seconds of a scene."""
MAX_PATH = 1024
"""Rows that all tracks together keep before the earlier ones are closed."""

NUMBER, TIME, STATUS, PLACE, BOX, ROW = 0, 1, 2, slice(3, 5), slice(5, 9), 9
"""Columns of a path: number of the track, time, status, column and row, left, top, right and bottom."""


class Status(IntEnum):
    """What a row of a path is: measured, predicted in a blob that it shares, or of an object that stands."""

    TENTATIVE = _kernels.TENTATIVE
    MEASURED = _kernels.MEASURED
    PREDICTED = _kernels.PREDICTED
    STATIONARY = _kernels.STATIONARY


class TrackingParams(Constants):
    """How blobs become tracks. A `size` is the mean of an object's height and width."""

    min_area_ratio: float = constant(0.0002, "A blob has at least this area, as a fraction of the image area.", gt=0)
    gate_sizes: float = constant(1.0, "A blob may be this many sizes from where its track is expected.", gt=0)
    max_lost_s: float = constant(1.0, "A track ends after this many seconds without a detection.", ge=0)
    min_track_s: float = constant(0.3, "A track is confirmed after at least this many seconds.", ge=0)
    min_travel_sizes: float = constant(
        0.7, "A track is confirmed once it has moved this many sizes; 0 confirms stationary ones too.", ge=0
    )
    min_contrast_sigma: float = constant(
        6.0, "A track is confirmed with this mean contrast, in deviations of the noise.", ge=0
    )
    stationary_after_s: float = constant(1.5, "An object that has not moved for this many seconds is stationary.", ge=0)
    stationary_max_s: float = constant(600.0, "A stationary object becomes background after this many seconds.", ge=0)


def column(first: int, width: int = 0) -> Any:
    """A column of the rows of tracks, or several."""
    at: Any = slice(first, first + width) if width else first
    return property(lambda tracks: tracks.rows[:, at])


class TrackTable(NamedTuple):
    """The fields of `Tracks`."""

    rows: Any
    path: Any


@safe_state
class Tracks(TrackTable):
    """N tracks; arrays in a call, tensors between calls.

    Attributes:
        rows: all that is known of each track, in the columns below, `[N, 42]` float64.
        path: what was reported of all of them, in the order of time, `[P, 9]`: number, time, status, column, row, left,
            top, right and bottom.
        number: in the order in which they began; status: a `Status`.
        began, seen: time of the first and of the latest detection.
        place: column and row at the latest detection, and velocity a second.
        extent: followed width and height.
        start: place at which it began.
        anchor: place to which it last moved on; anchored: time of that.
        detections: their number; alone: those in blobs of their own; contrast: mean, in deviations of the noise.
        area: of the latest detection, squared heights; color: followed color.
        inputs, outputs: of the network, sums over the rows of the path, `[N, 10]`.
    """

    __slots__ = ()

    number = column(_kernels.NUMBER)
    status = column(_kernels.STATUS)
    began = column(_kernels.BEGAN)
    seen = column(_kernels.SEEN)
    place = column(_kernels.PLACE, 2)
    velocity = column(_kernels.VELOCITY, 2)
    extent = column(_kernels.EXTENT, 2)
    start = column(_kernels.START, 2)
    anchor = column(_kernels.ANCHOR, 2)
    anchored = column(_kernels.ANCHORED)
    detections = column(_kernels.DETECTIONS)
    alone = column(_kernels.ALONE)
    contrast = column(_kernels.CONTRAST)
    area = column(_kernels.AREA)
    color = column(_kernels.COLOR, 3)
    inputs = column(_kernels.NETWORK, 10)
    outputs = column(_kernels.NETWORK + 10, 10)

    def take(self, which: Any) -> Tracks:
        """Some of the tracks, with their paths."""
        rows = self.rows[which]
        return Tracks(rows, self.path[np.isin(self.path[:, NUMBER], rows[:, _kernels.NUMBER])])

    @property
    def size(self) -> Numbers:
        """Mean of width and height, `[N]`."""
        return np.asarray((self.extent[:, 0] + self.extent[:, 1]) / 2)

    @property
    def confirmed(self) -> Bools:
        """Which tracks are objects, `[N]`."""
        return np.asarray(self.status > 0)


class Blobs(NamedTuple):
    """K blobs of a frame; lengths are fractions of the height. One without pixels has no area.

    Attributes:
        labels: number of the blob at every pixel from 1, 0 for none, `[h, w]` int32.
        box: left, top, right, bottom, `[K, 4]`.
        place: column and row of the centroid or of the pixel of the blob next to it, `[K, 2]`.
        looks: area, contrast in deviations of the noise, and color, `[K, 5]`.
        shared: whether it is a part of a blob of several tracks, `[K]`.
    """

    labels: Labels
    box: Numbers
    place: Numbers
    looks: Numbers
    shared: Bools

    @property
    def area(self) -> Numbers:
        """Squared heights, `[K]`."""
        return self.looks[:, 0]


def no_tracks() -> Tracks:
    """An empty table."""
    return Tracks(np.zeros((0, _kernels.TRACK_COLUMNS)), np.zeros((0, ROW)))


def joined(*tables: Tracks) -> Tracks:
    """Tables one after the other."""
    return Tracks(*map(np.concatenate, zip(*tables, strict=True)))


def update(
    tracks: Tracks, count: int, seen: Segmentation, time: float, seen_for: float, dt: float, p: TrackingParams
) -> tuple[Tracks, Tracks, Labels]:
    """One frame: blobs of the mask, divided among the tracks that meet in them, go to the tracks by one assignment.

    Args:
        tracks: those of the frame before.
        count: tracks begun so far.
        time: seconds, and seen_for: seconds since the scene began.
        dt: seconds between frames.

    Returns:
        Tracks that go on, tracks that ended, and the number of the track of every pixel plus one, `[h, w]`.
    """
    tracks = Tracks(tracks.rows.copy(), tracks.path)
    expected = tracks.place + tracks.velocity * np.minimum(time - tracks.seen, MAX_PREDICTION_S)[:, None]
    blobs = detect(seen, tracks, expected, p)
    i, j = assign(tracks, expected, blobs, time, p)
    paces = TAU_VELOCITY_S, TAU_SIZE_S, SHARED_GAIN
    measure_tracks(tracks.rows, expected, blobs.box, blobs.looks, blobs.shared, i, j, time, paces)
    number = np.full(len(blobs.area), -1.0)
    number[j] = tracks.number[i]
    tracks, j = begin(tracks, count, blobs, number, j, time)
    travel, age = (p.min_travel_sizes, MIN_TRAVEL), (p.min_contrast_sigma, p.min_track_s)
    confirm_tracks(tracks.rows, time, seen_for >= STARTING_S, (*travel, *age, p.stationary_after_s, MOVED_SIZES))
    if len(j):
        # What was measured, and after the old tracks the new ones: their rows.
        now = tracks.rows[np.concatenate([i, np.arange(len(tracks.rows) - len(j) + len(i), len(tracks.rows))])]
        head = now[:, [_kernels.NUMBER, _kernels.SEEN, _kernels.STATUS]]
        rows = np.concatenate([head, blobs.place[j], blobs.box[j]], 1)
        tracks = Tracks(tracks.rows, np.concatenate([tracks.path, rows]))
    labels = with_values(np.concatenate([[0], number + 1]).astype(np.int32), blobs.labels)
    missing, patience = time - tracks.seen, np.where(tracks.confirmed, p.max_lost_s, p.min_track_s)
    lost = missing > np.maximum(patience, 1.5 * dt)
    if not lost.any():
        return tracks, no_tracks(), labels
    return tracks.take(~lost), tracks.take(lost & tracks.confirmed), labels


def detect(seen: Segmentation, tracks: Tracks, expected: Numbers, p: TrackingParams) -> Blobs:
    """Connected components of a mask; fragments of an object are joined, and what objects share is divided.

    A component goes to the confirmed tracks whose expected boxes it fills. If there are several, each pixel goes to
    the track whose expected position is nearest, in units of its width and height.
    """
    import cv2

    height, least = len(seen.mask), p.min_area_ratio * seen.mask.size
    side = 2 * round(CLOSING * height / 2) + 1
    mask = cv2.morphologyEx(seen.mask, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    count, found = cv2.connectedComponents(mask)
    components, known = np.asarray(found, np.int32), np.flatnonzero(tracks.confirmed)
    extent, middle = tracks.extent[known] * height, expected[known] * height
    boxes = np.concatenate([middle - extent / 2, middle + extent / 2], 1)
    inside, areas = np.zeros((len(known), count)), np.zeros((1, count))
    count_inside(components, boxes, inside)
    count_inside(components, np.array([[0.0, 0.0, mask.shape[1], height]]), areas)
    areas = areas[0]
    # Of several fragments of one area the first.
    best = inside.argmax(1)
    claims = (inside.max(1) > CLAIM * np.minimum(extent.prod(1), areas[best])) & (best > 0)
    owner, claimed = np.arange(count), np.bincount(best[claims], minlength=count)
    for k in np.flatnonzero(claims).tolist():
        part = (inside[k] > INSIDE * areas) & (claimed == 0) & (FRAGMENT_AREA * areas < areas[best[k]])
        owner[part] = best[k]
    owner[(areas < least) & (owner == np.arange(count))] = 0
    names, table = np.unique(np.append(owner, 0), return_inverse=True)
    # Rows of those who share: blob that is divided, its part, expected position and size in pixels.
    shares, blobs = np.zeros((0, 6)), len(names) - 1
    for r in np.flatnonzero(claimed > 1).tolist():
        ones = np.flatnonzero(claims & (best == r))
        alone, together = tracks.alone[known[ones]], (tracks.detections - tracks.alone)[known[ones]]
        ones = ones[(together <= MAX_SHARED * alone) | (np.arange(len(ones)) == alone.argmax())]
        if len(ones) > 1:
            parts = np.append(table[r], blobs + 1 + np.arange(len(ones) - 1))
            blobs += len(ones) - 1
            new = np.column_stack([np.full(len(ones), table[r]), parts, middle[ones], extent[ones]])
            shares = np.concatenate([shares, new])
    labels, sums = np.empty(mask.shape, np.int32), np.empty((blobs, 12))
    name_blobs(components, table.astype(np.int32), shares, labels)
    sum_blobs(labels, seen.image, seen.distance, seen.sigma, sums)
    shared = np.zeros(blobs, bool)
    shared[shares[:, 1].astype(int) - 1] = True
    sums[:, 0] /= height**2
    return Blobs(labels, sums[:, 1:5] / height, (sums[:, 5:7] + 0.5) / height, sums[:, [0, 10, 7, 8, 9]], shared)


def with_values(table: npt.NDArray[Any], labels: Any) -> npt.NDArray[Any]:
    """The value of every label `[h, w]` in a table."""
    values = np.empty(labels.shape, table.dtype)
    look_up(table, labels, values)
    return values


def assign(tracks: Tracks, expected: Numbers, blobs: Blobs, time: float, p: TrackingParams) -> tuple[Whole, Whole]:
    """Pairs of tracks and blobs of the smallest cost: distance in gates. Overlapping pairs always may meet."""
    from scipy.optimize import linear_sum_assignment

    if not (len(tracks.rows) and len(blobs.area)):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    gate = p.gate_sizes * tracks.size * (1 + GATE_GROWTH * (time - tracks.seen))
    cost = np.empty((len(gate), len(blobs.area)))
    fill_costs(expected, tracks.extent, gate, tracks.area, blobs.box, blobs.area, (MAX_AREA_RATIO, CLAIM), cost)
    cost = np.where(cost < 1, cost - 0.01 * tracks.confirmed[:, None], 1.0)
    i, j = linear_sum_assignment(cost)
    good = cost[i, j] < 1
    return i[good], j[good]


def begin(tracks: Tracks, count: int, blobs: Blobs, number: Numbers, j: Whole, time: float) -> tuple[Tracks, Whole]:
    """Begin a track for every blob that is left and no fragment of a larger one beside it.

    Args:
        number: of the track of each blob, -1 for none; is completed.
        j: blobs of tracks.

    Returns:
        The tracks, and blobs of tracks, those of the new ones last.
    """
    if len(j) == len(number):
        return tracks, j
    low, high = blobs.box[:, :2], blobs.box[:, 2:]
    reach = (high - low).mean(1) / 2
    gap = np.maximum(low[:, None] - high, low - high[:, None]).max(-1)
    beside = (gap < reach) & (FRAGMENT_AREA * blobs.area[:, None] < blobs.area)
    (new,) = np.nonzero((number < 0) & ~beside.any(1) & ~blobs.shared)
    number[new] = count + np.arange(len(new))
    tracks = Tracks(np.concatenate([tracks.rows, np.zeros((len(new), _kernels.TRACK_COLUMNS))]), tracks.path)
    fresh = Tracks(tracks.rows[len(tracks.rows) - len(new) :], tracks.path)
    fresh.number[...], fresh.began[...], fresh.seen[...], fresh.anchored[...] = number[new], time, time, time
    fresh.place[...] = fresh.start[...] = fresh.anchor[...] = (low + high)[new] / 2
    fresh.extent[...] = (high - low)[new]
    fresh.detections[...] = fresh.alone[...] = 1
    fresh.area[...], fresh.contrast[...], fresh.color[...] = blobs.area[new], blobs.looks[new, 1], blobs.looks[new, 2:]
    return tracks, np.concatenate([j, new])


def kept_from_background(tracks: Tracks, labels: Labels, time: float, p: TrackingParams) -> Bytes:
    """1 where the background is not learned, `[h, w]`: under objects and beside them, and under young tracks."""
    import cv2

    keep = np.where(tracks.confirmed, time - tracks.anchored < p.stationary_max_s, time - tracks.began < TENTATIVE_S)
    return np.asarray(cv2.dilate(with_values(flags(tracks, keep), labels), SQUARE), np.uint8)


def flags(tracks: Tracks, which: Bools) -> Bytes:
    """1 for the labels of some of the tracks, 0 for others, up to the largest."""
    table = np.zeros(int(tracks.number.max(initial=-1)) + 2, np.uint8)
    table[tracks.number[which].astype(np.int64) + 1] = 1
    return table


def replace_ghosts(
    tracks: Tracks, labels: Labels, seen: Segmentation, s: BackgroundState, after: float, p: TrackingParams
) -> None:
    """Take the image into the background where an object has left what was learned as background; `s` is updated.

    Looked at are parts of the foreground without motion for `after` seconds that are of no moving object.
    """
    import cv2

    moving = flags(tracks, (tracks.status == Status.MEASURED) | (tracks.status == Status.PREDICTED))
    static = np.empty_like(seen.mask)
    if mark_static(seen.mask, s.static_time, s.known, labels, moving, after, static) < p.min_area_ratio * static.size:
        return
    count, parts, stats, _ = cv2.connectedComponentsWithStatsWithAlgorithm(static, 8, cv2.CV_32S, cv2.CCL_GRANA)
    for r in range(1, count):
        left, top, width, height, area = stats[r].tolist()
        if area < p.min_area_ratio * static.size:
            continue
        rows, columns = slice(max(0, top - 3), top + height + 3), slice(max(0, left - 3), left + width + 3)
        region = (parts[rows, columns] == r).astype(np.uint8)
        window = seen.image[:, rows, columns], s.mean[:, rows, columns]
        if is_ghost(region, seen.mask[rows, columns] & ~region & 1, *window):
            wide = cv2.dilate(region, SQUARE) > 0
            for new, old in zip(*window, strict=True):
                old[wide] = new[wide]
