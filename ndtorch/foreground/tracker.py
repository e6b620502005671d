"""Tracks of the blobs of a foreground mask: constant velocity and one assignment, as SORT (Bewley et al. 2016), with
confirmation by travel, stationary objects and ghosts.

Lengths are fractions of the image height; a *size* is the mean of an object's height and width.
"""

from __future__ import annotations

from enum import IntEnum
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.config import Constants, constant
from ndtorch.foreground._kernels import look_up, mark_static, sum_blobs
from ndtorch.foreground.background import SQUARE, BackgroundState, Bytes, Labels, Numbers, Segmentation, is_ghost

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
MAX_PATH = 4096
"""Rows that all tracks together keep before the earlier ones are closed."""
CONFIDENT_SIZES = 1.0
"""Travel in sizes of a track of confidence one half."""

NUMBER, TIME, STATUS, PLACE, BOX, ROW = 0, 1, 2, slice(3, 5), slice(5, 9), 9
"""Columns of a path: number of the track, time, status, column and row, left, top, right and bottom."""


class Status(IntEnum):
    """What a row of a path is: measured, predicted in a blob that it shares, or of an object that stands."""

    TENTATIVE = 0
    MEASURED = 1
    PREDICTED = 2
    STATIONARY = 3


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


class Tracks(NamedTuple):
    """N tracks; arrays in a call, tensors between calls.

    Attributes:
        number: in the order in which they began, `[N]` int64.
        status: a `Status`, `[N]` int64.
        began, seen: time of the first and of the latest detection, `[N]` float64.
        place: column and row at the latest detection, `[N, 2]`, and velocity a second, `[N, 2]`.
        extent: followed width and height, `[N, 2]`.
        start: place at which it began, `[N, 2]`; travel: largest distance from it in sizes, `[N]`.
        anchor: place to which it last moved on, `[N, 2]`; anchored: time of that, `[N]`.
        count: detections, `[N]`; contrast: their mean contrast in deviations of the noise, `[N]`.
        alone: detections in blobs of their own, `[N]`.
        area: of the latest detection, squared heights, `[N]`; color: followed color, `[N, 3]`.
        inputs, outputs: of the network, sums over the rows of the path, `[N, 10]`.
        path: what was reported of all of them, in the order of time, `[P, 9]`: number, time, status, column, row, left,
            top, right and bottom.
    """

    number: Any
    status: Any
    began: Any
    seen: Any
    place: Any
    velocity: Any
    extent: Any
    start: Any
    travel: Any
    anchor: Any
    anchored: Any
    count: Any
    contrast: Any
    area: Any
    color: Any
    alone: Any
    inputs: Any
    outputs: Any
    path: Any

    def take(self, which: Any) -> Tracks:
        """Some of the tracks, with their paths."""
        columns = [column[which] for column in self[:-1]]
        return Tracks._make([*columns, self.path[np.isin(self.path[:, NUMBER], columns[0])]])

    @property
    def size(self) -> Numbers:
        """Mean of width and height, `[N]`."""
        return np.asarray(self.extent[:, 0] + self.extent[:, 1]) / 2

    @property
    def confirmed(self) -> Bools:
        """Which tracks are objects, `[N]`."""
        return np.asarray(self.status > 0)


class Blobs(NamedTuple):
    """K blobs.

    Attributes:
        labels: number of the blob at every pixel from 1, 0 for none, `[h, w]` int32.
        place: column and row of the pixel of the blob next to its centroid, and middle: of its box, `[K, 2]`.
        box: left, top, right, bottom, `[K, 4]`.
        area: `[K]`; color: `[K, 3]`; contrast: in deviations of the noise, `[K]`.
        shared: whether it is a part of a blob of several tracks, `[K]`.
    """

    labels: Labels
    place: Numbers
    middle: Numbers
    box: Numbers
    area: Numbers
    color: Numbers
    contrast: Numbers
    shared: Bools


@cache
def no_tracks() -> Tracks:
    """An empty table."""
    kinds = {"number": np.int64, "status": np.int64}
    widths = {"place": 2, "velocity": 2, "extent": 2, "start": 2, "anchor": 2, "color": 3, "inputs": 10, "outputs": 10}
    shapes = {name: (0, widths[name]) if name in widths else (0,) for name in Tracks._fields} | {"path": (0, ROW)}
    return Tracks(*(np.zeros(shapes[name], kinds.get(name, np.float64)) for name in Tracks._fields))


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
    expected = tracks.place + tracks.velocity * np.minimum(time - tracks.seen, MAX_PREDICTION_S)[:, None]
    blobs = detect(seen, tracks, expected, p)
    i, j = assign(tracks, expected, blobs, time, p)
    tracks = measure(tracks, expected, blobs, i, j, time)
    tracks, number = begin(tracks, count, blobs, i, j, time)
    tracks = confirm(tracks, time, seen_for, p)
    tracks = report(tracks, blobs, number, time)
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

    height = len(seen.mask)
    side = 2 * round(CLOSING * height / 2) + 1
    mask = cv2.morphologyEx(seen.mask, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    small = areas < p.min_area_ratio * mask.size
    known = np.flatnonzero(tracks.confirmed)
    inside = np.zeros((len(known), count), np.int64)
    boxes = np.concatenate([expected - tracks.extent / 2, expected + tracks.extent / 2], 1)[known] * height
    for k, (left, top, right, bottom) in enumerate(boxes.round().astype(int).clip(0).tolist()):
        inside[k] = np.bincount(labels[top:bottom, left:right].ravel(), minlength=count)
    inside[:, 0] = 0
    best = inside.argmax(1) if count > 1 else np.zeros(len(known), np.int64)
    claim = np.minimum((tracks.extent[known] * height).prod(1), areas[best]) * CLAIM
    claims = (inside[np.arange(len(known)), best] > claim) & (best > 0)
    owner, claimed = np.arange(count), np.bincount(best[claims], minlength=count)
    for k in np.flatnonzero(claims).tolist():
        part = (inside[k] > INSIDE * areas) & (claimed == 0) & (FRAGMENT_AREA * areas < areas[best[k]])
        owner[part] = best[k]
    small &= owner == np.arange(count)
    owner[small] = 0
    names = np.unique(owner)
    if len(names) < count:
        labels = with_values(np.searchsorted(names, owner).astype(np.int32), labels)
    shared = np.zeros(len(names) - (names[0] == 0), bool) if len(names) else np.zeros(0, bool)
    for r in np.flatnonzero(claimed > 1).tolist():
        ones = known[claims & (best == r)]
        alone = tracks.alone[ones]
        ones = ones[(tracks.count[ones] - alone <= MAX_SHARED * alone) | (np.arange(len(ones)) == alone.argmax())]
        if len(ones) < 2:
            continue
        rows, columns = np.nonzero(labels == np.searchsorted(names, r))
        at = (np.stack([columns, rows], 1) + 0.5) / height
        away = np.stack([(((at - expected[k]) / tracks.extent[k]) ** 2).sum(1) for k in ones])
        part = away.argmin(0)
        number = np.concatenate([[np.searchsorted(names, r)], len(shared) + 1 + np.arange(len(ones) - 1)])
        labels[rows, columns] = number[part]
        shared = np.concatenate([shared, np.ones(len(ones) - 1, bool)])
        shared[number[0] - 1] = True
    return describe(np.asarray(labels, np.int32), shared, seen)


def describe(labels: Labels, shared: Bools, seen: Segmentation) -> Blobs:
    """Measurements of labelled blobs; blobs without pixels are left out."""
    height, sums = labels.shape[0], np.empty((len(shared), 11))
    sum_blobs(labels, seen.image, seen.distance, seen.sigma, sums)
    present = sums[:, 0] > 0
    if not present.all():
        labels = with_values(np.concatenate([[0], present.cumsum() * present]).astype(np.int32), labels)
        sums, shared = sums[present], shared[present]
    area, box = sums[:, 0], sums[:, 1:5] / height
    means = sums[:, 5:] / area[:, None]
    center = means[:, :2].copy()
    for k, (x, y) in enumerate(center.tolist()):
        if labels[round(y), round(x)] != k + 1:
            rows, columns = np.nonzero(labels == k + 1)
            nearest = np.argmin((columns - x) ** 2 + (rows - y) ** 2)
            center[k] = columns[nearest], rows[nearest]
    middle = (box[:, :2] + box[:, 2:]) / 2
    return Blobs(labels, (center + 0.5) / height, middle, box, area / height**2, means[:, 2:5], means[:, 5], shared)


def with_values(table: npt.NDArray[Any], labels: Any) -> npt.NDArray[Any]:
    """The value of every label `[h, w]` in a table."""
    values = np.empty(labels.shape, table.dtype)
    look_up(table, labels, values)
    return values


def assign(tracks: Tracks, expected: Numbers, blobs: Blobs, time: float, p: TrackingParams) -> tuple[Whole, Whole]:
    """Pairs of tracks and blobs of the smallest cost: distance in gates. Overlapping pairs always may meet."""
    from scipy.optimize import linear_sum_assignment

    gate = p.gate_sizes * tracks.size * (1 + GATE_GROWTH * (time - tracks.seen))
    away = np.linalg.norm(expected[:, None] - blobs.middle[None], axis=-1)
    cost = away / np.maximum(gate, 1e-9)[:, None]
    ratio = np.abs(np.log(tracks.area[:, None] / blobs.area[None]))
    cost[ratio > np.log(MAX_AREA_RATIO)] = np.inf
    half = tracks.extent / 2
    low = np.maximum((expected - half)[:, None], blobs.box[None, :, :2])
    common = (np.minimum((expected + half)[:, None], blobs.box[None, :, 2:]) - low).clip(0).prod(-1)
    smaller = np.minimum(tracks.extent.prod(1)[:, None], (blobs.box[:, 2:] - blobs.box[:, :2]).prod(1)[None])
    overlap = common / np.maximum(smaller, 1e-12)
    cost = np.where(overlap > CLAIM, np.minimum(cost, 1 - overlap / 2), cost)
    cost = np.where(cost < 1, cost - 0.01 * tracks.confirmed[:, None], 1.0)
    i, j = linear_sum_assignment(cost)
    good = cost[i, j] < 1
    return i[good], j[good]


def measure(tracks: Tracks, expected: Numbers, blobs: Blobs, i: Whole, j: Whole, time: float) -> Tracks:
    """Take the assigned blobs into their tracks. Of a shared blob the size is remembered, not measured."""
    place, velocity, extent, color = (tracks[k].copy() for k in (4, 5, 6, 14))
    gap, shared = time - tracks.seen[i], blobs.shared[j]
    measured = np.where(shared[:, None], expected[i] + SHARED_GAIN * (blobs.middle[j] - expected[i]), blobs.middle[j])
    # Of a young track the velocity is the mean of all steps so far.
    pace = np.maximum(gap / (TAU_VELOCITY_S + gap), 1 / np.maximum(tracks.count[i], 1))
    velocity[i] += (pace / gap)[:, None] * (measured - expected[i])
    place[i] = measured
    keep = np.where(shared, 0.0, gap / (TAU_SIZE_S + gap))[:, None]
    extent[i] += keep * (blobs.box[j, 2:] - blobs.box[j, :2] - extent[i])
    color[i] += keep * (blobs.color[j] - color[i])
    seen, area, count, contrast = (tracks[k].copy() for k in (3, 13, 11, 12))
    seen[i], area[i] = time, np.where(shared, area[i], blobs.area[j])
    contrast[i] += (blobs.contrast[j] - contrast[i]) / (count[i] + 1)
    count[i] += 1
    alone = tracks.alone.copy()
    alone[i] += ~shared
    size = extent.mean(1)
    travel = np.maximum(tracks.travel, np.hypot(*(place - tracks.start).T) / size)
    moved = np.hypot(*(place - tracks.anchor).T) > MOVED_SIZES * size
    status = tracks.status.copy()
    status[i] = np.where(tracks.confirmed[i], np.where(shared, Status.PREDICTED, Status.MEASURED), Status.TENTATIVE)
    return tracks._replace(
        status=status,
        seen=seen,
        place=place,
        velocity=velocity,
        extent=extent,
        travel=travel,
        anchor=np.where(moved[:, None], place, tracks.anchor),
        anchored=np.where(moved, time, tracks.anchored),
        count=count,
        contrast=contrast,
        area=area,
        color=color,
        alone=alone,
    )


def begin(tracks: Tracks, count: int, blobs: Blobs, i: Whole, j: Whole, time: float) -> tuple[Tracks, Whole]:
    """Begin a track for every blob that is left and no fragment of a larger one beside it.

    Returns:
        The tracks, and the number of the track of each blob, -1 for none.
    """
    number = np.full(len(blobs.area), -1, np.int64)
    number[j] = tracks.number[i]
    if (number >= 0).all():
        return tracks, number
    low, high = blobs.box[:, :2], blobs.box[:, 2:]
    reach = ((high - low).mean(1) / 2)[None]
    gap = np.maximum(low[:, None] - high[None], low[None] - high[:, None]).max(-1)
    beside = (gap < reach) & (FRAGMENT_AREA * blobs.area[:, None] < blobs.area[None])
    (new,) = np.nonzero((number < 0) & ~beside.any(1) & ~blobs.shared)
    number[new] = count + np.arange(len(new))
    n, place, zero = len(new), blobs.middle[new], np.zeros(len(new))
    extent = blobs.box[new, 2:] - blobs.box[new, :2]
    fresh = no_tracks()._replace(
        number=number[new],
        status=np.zeros(n, np.int64),
        began=zero + time,
        seen=zero + time,
        place=place,
        velocity=np.zeros((n, 2)),
        extent=extent,
        start=place,
        travel=zero,
        anchor=place,
        anchored=zero + time,
        count=zero + 1,
        contrast=blobs.contrast[new],
        area=blobs.area[new],
        color=blobs.color[new],
        alone=zero + 1,
        inputs=np.zeros((n, 10)),
        outputs=np.zeros((n, 10)),
    )
    return joined(tracks, fresh), number


def confirm(tracks: Tracks, time: float, seen_for: float, p: TrackingParams) -> Tracks:
    """A tentative track is confirmed by age, travel and contrast; an object that does not move on is stationary."""
    net = np.hypot(*(tracks.place - tracks.start).T)
    enough = np.maximum(p.min_travel_sizes * tracks.size, MIN_TRAVEL) if p.min_travel_sizes else 0.0
    proven = (net >= enough) & (tracks.contrast >= p.min_contrast_sigma) & (time - tracks.began >= p.min_track_s)
    new = proven & (tracks.seen == time) & ~tracks.confirmed & (seen_for >= STARTING_S)
    status = np.where(new, Status.MEASURED, tracks.status)
    still = tracks.confirmed & (status != Status.PREDICTED) & (time - tracks.anchored >= p.stationary_after_s)
    return tracks._replace(status=np.where(still, Status.STATIONARY, status))


def report(tracks: Tracks, blobs: Blobs, number: Whole, time: float) -> Tracks:
    """Add a row to the paths for every track of this frame: what was measured, its part of a shared blob."""
    (k,) = np.nonzero(tracks.seen == time)
    if not len(k):
        return tracks
    order = np.argsort(number)
    j = order[np.searchsorted(number[order], tracks.number[k])]
    head = np.stack([tracks.number[k], np.full(len(k), time), tracks.status[k]], 1)
    return tracks._replace(path=np.concatenate([tracks.path, np.concatenate([head, blobs.place[j], blobs.box[j]], 1)]))


def kept_from_background(tracks: Tracks, labels: Labels, time: float, p: TrackingParams) -> Bytes:
    """1 where the background is not learned, `[h, w]`: under objects and beside them, and under young tracks."""
    import cv2

    keep = np.where(tracks.confirmed, time - tracks.anchored < p.stationary_max_s, time - tracks.began < TENTATIVE_S)
    return np.asarray(cv2.dilate(with_values(flags(tracks, keep), labels), SQUARE), np.uint8)


def flags(tracks: Tracks, which: Bools) -> Bytes:
    """1 for the labels of some of the tracks, 0 for others, up to the largest."""
    table = np.zeros(int(tracks.number.max(initial=-1)) + 2, np.uint8)
    table[tracks.number[which] + 1] = 1
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
    count, parts, stats, _ = cv2.connectedComponentsWithStats(static)
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


def confidence(tracks: Tracks) -> Numbers:
    """Rank of tracks as objects, 0 to 1, by the distance they went in sizes; no probability, `[N]`."""
    return np.asarray(tracks.travel / (tracks.travel + CONFIDENT_SIZES))
