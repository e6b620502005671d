"""Association of blobs with tracks: by overlap with where a track is expected, then by distance, color and size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ndtorch.foreground.arrays import Floats, Numbers
from ndtorch.tracking._kernels_blobs import overlaps
from ndtorch.tracking.blobs import Blobs
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.rigid_motion import has_contrast
from ndtorch.tracking.track import PIXELS, PLACE, Track

MIN_OVERLAP = 0.3
"""A track meets a blob if this share of the blob or of the track's box overlaps."""
GATE_GROWTH_PER_S = 1.0
"""The gate of a track out of sight grows by this share each second."""
MIN_CONTAINMENT = 0.6
"""A blob of which this share lies in a track's box is a fragment of it."""
MIN_AGE_S = 1.0
"""A track that was in sight for so many seconds is no fragment: those of one object merge and split all the time."""
USUAL = 5
"""The usual area of a track is the median of so many detections: noise merges with a small blob for one."""
OCCLUSION_MIN_VISIBLE = 0.5
"""A track in a shared blob is hidden if there is room for less than this share of it."""


class Association(NamedTuple):
    """Numbers of the tracks of each blob, and the track of each blob that is a fragment of one."""

    tracks: dict[int, list[int]]
    fragments: dict[int, int]

    @property
    def unmatched_blobs(self) -> list[int]:
        return [r for r, ks in self.tracks.items() if not ks and r not in self.fragments]


def associate(tracks: Sequence[Track], time: float, blobs: Blobs, p: TrackingParams) -> Association:
    """Each track goes to the blob that fills most of its expected box. Other blobs inside the box are fragments."""
    height = blobs.labels.shape[0]
    areas = blobs.areas.tolist()
    given: dict[int, list[int]] = {r: [] for r in range(len(areas))}
    fragments: dict[int, int] = {}
    if not areas or not tracks:
        return Association(given, fragments)
    counts = overlap_pixels([track.box(time, p.max_prediction_s) for track in tracks], blobs)
    inside, largest = counts.tolist(), [0] * len(tracks)
    for k, (track, r) in enumerate(zip(tracks, counts.argmax(1).tolist(), strict=True)):
        if inside[k][r] > MIN_OVERLAP * min(areas[r], track.last[PIXELS] * height * height):
            given[r].append(k)
            largest[k] = areas[r]
    for r, k in enumerate(counts.argmax(0).tolist()):
        # What is nearly as large as the rest of it is no fragment: a group has split.
        contained = inside[k][r] > MIN_CONTAINMENT * areas[r]
        if not given[r] and contained and p.parent_area_ratio * areas[r] < largest[k]:
            fragments[r] = k
    return Association(given, fragments)


def overlap_pixels(boxes: Sequence[tuple[float, float, float, float]], blobs: Blobs) -> Numbers:
    """Pixels of each of R blobs in each of K boxes (fractions of the height), `[K, R]`."""
    inside = np.zeros((len(boxes), len(blobs.areas)))
    overlaps(blobs.labels, np.array(boxes) * blobs.labels.shape[0], inside)
    return inside


def assign_unmatched(
    tracks: Sequence[Track], found: Association, blobs: Blobs, image: Floats, time: float, p: TrackingParams
) -> None:
    """Give tracks and blobs that met nothing to each other by the cheapest assignment; `found` is changed."""
    from scipy.optimize import linear_sum_assignment

    taken = {k for ks in found.tracks.values() for k in ks}
    lost, free = [k for k in range(len(tracks)) if k not in taken], found.unmatched_blobs
    if not lost or not free:
        return
    left = [tracks[k] for k in lost]
    cost = pair_costs(left, free, blobs, image, time, p.color_cost, 1.0, p)
    if not (cost < 1).any():
        return
    rows, columns = linear_sum_assignment(cost)
    for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
        if cost[i, j] < 1:
            found.tracks[free[j]].append(lost[i])


NEVER = 1e3
"""Cost of a pair that cannot be."""


def pair_costs(
    tracks: Sequence[Track],
    where: Sequence[int],
    blobs: Blobs,
    image: Floats,
    time: float,
    color_cost: float,
    limit: float,
    p: TrackingParams,
) -> Numbers:
    """Cost of each of K tracks in each of R blobs, `[K, R]`: distance in gates and color difference.

    Args:
        where: numbers of the blobs.
        color_cost: of a color difference of full scale.
        limit: pairs of this cost or more, or of an area unlike the latest and the usual, cost `NEVER`; if it is
            infinite, none does.
    """
    height = blobs.labels.shape[0]
    found = np.full((len(tracks), len(where)), NEVER)
    expected = [track.expected(time, p.max_prediction_s) for track in tracks]
    clear = [before_noise(track, time, p) for track in tracks]
    gates = [p.gate_sizes * track.size * (1 + GATE_GROWTH_PER_S * (time - track.last_seen)) for track in tracks]
    for j, r in enumerate(where):
        top, left, bottom, right = blobs.boxes[r].tolist()
        row, column = (top + bottom) / 2 / height, (left + right) / 2 / height
        area, color = blobs.areas[r] / height**2, None
        for i, track in enumerate(tracks):
            value, before = math.dist((row, column), expected[i]), clear[i]
            if before is not None and before[PIXELS] / p.max_area_ratio < area < before[PIXELS] * p.max_area_ratio:
                value = min(value, math.dist((row, column), before[PLACE]))
            value /= gates[i]
            if value >= limit:
                continue
            pixels = (track.last[PIXELS], usual_pixels(track)) if limit < math.inf else (0.0, math.inf)
            if not min(pixels) / p.max_area_ratio < area < max(pixels) * p.max_area_ratio:
                continue
            if color is None:
                window = blobs.labels[top:bottom, left:right] == r + 1
                color = image[:, top:bottom, left:right][:, window].mean(1)
            value += color_cost * float(np.abs(color - track.color).max())
            if value < limit:
                found[i, j] = value
    return found


def before_noise(track: Track, time: float, p: TrackingParams) -> Sequence[float] | None:
    """The latest detection but one of an object that was much larger at the latest one, a step ago: noise was added."""
    if not track.is_object or track.age < MIN_AGE_S:
        return None
    last, before = track.last, track.new_detections[-2] if len(track.new_detections) > 1 else track.detections[-1]
    lately = time - last[0] < 1.5 * (last[0] - before[0])
    return before if lately and last[PIXELS] > p.max_area_ratio * before[PIXELS] else None


def usual_pixels(track: Track) -> float:
    """Area of a track for the last `USUAL` detections, of the latest one for `MIN_AGE_S`."""
    return float(np.median(track.path[-USUAL:, PIXELS])) if track.age > MIN_AGE_S else track.last[PIXELS]


class Sharing(NamedTuple):
    """Tracks of one blob: those visible in it, those hidden there, and those that are parts of another."""

    visible: list[Track]
    hidden: list[Track]
    parts: list[Track]


def share_blob(tracks: list[Track], area: float, p: TrackingParams) -> Sharing:
    """Which of the tracks that met one blob of an area (squared heights) are visible in it.

    A track that runs into a larger one soon after it began was a part of it, and of such only the oldest large one
    stays. Of the others, the oldest are visible as long as there is room; the rest is hidden.
    """
    if len(tracks) < 2:
        return Sharing(tracks, [], [])
    largest = max(track.last[PIXELS] for track in tracks)
    objects = [
        track for track in tracks if track.is_object and not (track.age < MIN_AGE_S and is_part(track, largest, p))
    ]
    # One that was apart for a while, and is no small part, stays one of its own.
    most = max((track.last[PIXELS] for track in objects or tracks), default=0.0)
    objects += [
        track for track in tracks if not track.is_object and is_lasting(track, p) and not is_part(track, most, p)
    ]
    if not objects:
        oldest = min((track for track in tracks if not is_part(track, most, p)), key=lambda track: track.number)
        return Sharing([oldest], [], [track for track in tracks if track is not oldest])
    parts = [track for track in tracks if all(track is not other for other in objects)]
    objects.sort(key=lambda track: track.number)
    shown, hidden = list[Track](), list[Track]()
    for track in objects:
        (shown if not shown or has_room(track, shown, area) else hidden).append(track)
    return Sharing(shown, hidden, parts)


def has_room(track: Track, shown: Sequence[Track], area: float) -> bool:
    return sum(other.last[PIXELS] for other in shown) + OCCLUSION_MIN_VISIBLE * track.last[PIXELS] < area


def is_part(track: Track, most: float, p: TrackingParams) -> bool:
    """Whether a track has less than a fraction of so many pixels."""
    return p.parent_area_ratio * track.last[PIXELS] < most


def is_lasting(track: Track, p: TrackingParams) -> bool:
    """Whether a track was in sight for long enough to be an object, and is no pale fragment."""
    return track.age >= p.min_track_s and (not p.min_travel_sizes or has_contrast(track, p))
