"""Clutter: places where tracks come and go without becoming objects, and particles of one size (snow, glints)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ndtorch.foreground.arrays import Floats, Numbers
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.track import BOX, PIXELS, PLACE, Track, is_small

CELL = 1 / 56
"""Side of a cell of the clutter map, as a fraction of the image height."""
CLUTTER_DECAY_S = 20.0
"""Clutter is forgotten with this time constant in seconds."""
CLUTTER_WINDOW_S = 5.0
"""Births of tracks are counted over this many seconds."""
CLUTTER_LEVEL = 0.5
"""A track is in clutter if so many tracks came and went in the mean over its box."""
MIN_BIRTH_S = 0.08
"""Tracks in sight for no longer than this are noise."""
NEAR_OBJECT_SIZES, NEAR_OBJECT_S = 0.5, 0.5
"""A track is near an object if it was within so many of its sizes, from so many seconds before to so many after."""
SIZE_RATIO = 1.5
"""Particles are of one size if their sides differ by less than this ratio."""
RADIUS = 0.2
"""Particles are counted around a track up to so many image heights away."""
MIN_COUNT = 4
"""Fewer particles than this are none."""
BIRTH = 5
"""Numbers kept of a birth: track, time, row and column, and the root of its pixels."""


def empty_clutter_map(height: int, width: int) -> Floats:
    """Nothing has come and gone yet, `[rows, columns]`, for an image of so many pixels."""
    return np.zeros((round(1 / CELL), max(1, math.ceil(width / height / CELL))), np.float32)


def update_clutter_map(
    before: Floats, lost: Sequence[Track], tracks: Sequence[Track], dt: float, p: TrackingParams
) -> Floats:
    """How many tracks have come and gone in every cell lately without becoming an object, and without one near.

    Fragments and shadows of objects come and go as well, so those near one say nothing about the place.

    Args:
        before: a step ago, `[rows, columns]`.
        lost: tracks that ended at this step; tracks: those that go on.
        dt: seconds of a step.
    """
    width = before.shape[1] / before.shape[0]
    gone = [one for one in lost if not one.is_object and one.age > MIN_BIRTH_S]
    gone = [one for one in gone if not is_small(one, width, p)]
    if not gone and not before.any():
        return before
    after = before * np.float32(math.exp(-dt / CLUTTER_DECAY_S))
    objects = [one for one in (*lost, *tracks) if one.is_object] if gone else []
    for one in gone:
        path = one.path
        if not any(is_near(path, other) for other in objects):
            cells = np.zeros(after.shape, bool)
            for box in path[:, BOX]:
                cells[window(box)] = True
            after[cells] += 1
    return after


def is_near(path: Numbers, other: Track) -> bool:
    """Whether an object was near a track with that path `[n, 10]` while it was in sight, or shortly before or after."""
    first, last = path[0, 0] - NEAR_OBJECT_S, path[-1, 0] + NEAR_OBJECT_S
    its = other.path
    its = its[(its[:, 0] >= first) & (its[:, 0] <= last)]
    (top, left), (bottom, right) = path[:, 3:5].min(0), path[:, 5:7].max(0)
    gap = NEAR_OBJECT_SIZES * other.size
    beside = (its[:, 3] - gap < bottom) & (its[:, 5] + gap > top) & (its[:, 4] - gap < right) & (its[:, 6] + gap > left)
    return bool(beside.any())


def clutter_at(track: Track, clutter: Floats) -> float:
    """How many tracks have come and gone where a track is now, in the mean over its box."""
    return float(clutter[window(np.array(track.last[BOX]))].mean())


def window(box: Numbers) -> tuple[slice, slice]:
    """The cells of a box, at least one; top, left, bottom and right are fractions of the height."""
    top, left = (max(0, int(side / CELL)) for side in box[:2].tolist())
    bottom, right = (max(1, math.ceil(side / CELL)) for side in box[2:].tolist())
    return slice(min(top, bottom - 1), bottom), slice(min(left, right - 1), right)


def recent_births(
    before: Numbers, tracks: Sequence[Track], lost: Sequence[Track], time: float, p: TrackingParams
) -> Numbers:
    """The tracks that began lately, `[N, 5]`, except those beside a larger object: fragments and shadows come with it.

    A track is counted once, when it has been in sight for `min_track_s`: by then it is known what is an object beside
    it. One that ended before is counted when it ends.

    Args:
        before: a step ago.
        tracks: those that go on; lost: those that ended at this step.
    """
    kept = before[time - before[:, 1] < CLUTTER_WINDOW_S] if len(before) else before
    new = [one for one in tracks if one.last_seen == time and was_born(one, p)]
    new += [one for one in lost if MIN_BIRTH_S < one.age <= p.min_track_s]
    if not new:
        return kept
    objects, rows = [one for one in tracks if one.is_object], []
    for one in new:
        path = one.path
        most = p.parent_area_ratio * path[:, PIXELS].max()
        if not any(other.last[PIXELS] > most and is_near(path, other) for other in objects):
            rows.append((one.number, one.first_seen, *path[0, PLACE].tolist(), side_of(path, 0.5)))
    return np.concatenate([kept, np.array(rows).reshape(-1, BIRTH)])


def side_of(path: Numbers, share: float) -> float:
    """Side of a square of as many pixels as a track `[n, 10]` had at most in that share of its detections."""
    return math.sqrt(np.sort(path[:, PIXELS])[int(share * len(path))])


def was_born(track: Track, p: TrackingParams) -> bool:
    """Whether a track has been in sight for longer than `min_track_s` for the first time."""
    if not track.new_detections or track.count < 2:
        return False
    new = track.new_detections
    previous = new[-2][0] if len(new) > 1 else float(track.detections[-1, 0])
    return previous - track.first_seen <= p.min_track_s < track.age


def is_particle_clutter(track: Track, births: Numbers, seen_for: float, width: float, p: TrackingParams) -> bool:
    """Whether many tracks of its size began lately: everywhere, or fewer of them close together around it.

    A busy road has objects of one size too, but not as many, and its small ones are fragments of larger ones.

    Args:
        births: of `recent_births`.
        seen_for: seconds since the scene began.
        width: of the image in heights.
    """
    if not p.min_travel_sizes or len(births) < MIN_COUNT:
        return False
    # What began a scene came at once: that is no rate.
    span = max(1.0, min(seen_for, CLUTTER_WINDOW_S))
    row, column = track.last[PLACE]
    tall = min(row + RADIUS, 1.0) - max(row - RADIUS, 0.0)
    wide = min(column + RADIUS, width) - max(column - RADIUS, 0.0)
    most, crowd = p.clutter_rate * span * width, max(MIN_COUNT - 1, p.clutter_density * span * tall * wide)
    # Mostly they are too few, of whatever size.
    if len(births) <= min(most, crowd):
        return False
    beside = (np.abs(births[:, 2] - row) < RADIUS) & (np.abs(births[:, 3] - column) < RADIUS)
    if len(births) <= most and int(beside.sum()) <= crowd:
        return False
    # Glints merge and split; what leaves the image is small at last.
    size = side_of(track.path, 0.25)
    alike = (births[:, 4] > size / SIZE_RATIO) & (births[:, 4] < size * SIZE_RATIO) & (births[:, 0] != track.number)
    everywhere = int(alike.sum())
    if everywhere < MIN_COUNT:
        return False
    return everywhere > most or int((alike & beside).sum()) > crowd
