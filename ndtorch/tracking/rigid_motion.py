"""Rigid motion: whether the appearance of a track moved with it and left its old place, and the length of its path.

Pieces that come and go side by side, leaves that sway, and blocks of a codec shift the middle of a blob, but what was
there stays there. The squared differences of the kept appearance from what is at its old place later, and from what is
at the new place, are summed over the track's life, so high contrast counts for more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ndtorch.foreground.arrays import Bytes, Floats
from ndtorch.tracking._kernels_tracks import patch_distance
from ndtorch.tracking.clutter import clutter_at
from ndtorch.tracking.params import TrackingParams
from ndtorch.tracking.track import BOX, PLACE, Track

STRIDE_SIZES, MIN_STRIDE_PX = 0.35, 2.0
"""The appearance is compared each time the track has moved this many sizes, and at least so many pixels."""
MIN_RIGIDITY = -0.05
"""A track moves rigidly if its new place fits better than its old by this ratio."""
RIGIDITY_NOISE = 0.25
"""Differences of this fraction of the light are needed before an appearance says anything."""
PATH_STEP_SIZES = 0.2
"""Paths are measured in steps of this many sizes."""
MIN_NET_TRAVEL_RATIO, MIN_GROWTH_SIZES = 0.35, 0.5
"""In probation a track has to get this fraction of its path away from its start, and this many sizes."""
HALF_TRAVEL_SIZES = 3.0
"""A straight path of so many sizes has a squared confidence of a half."""


def has_contrast(track: Track, p: TrackingParams) -> bool:
    """Whether the mean contrast of all its detections says that it is no chance fragment of anything."""
    return track.contrast_sum >= p.min_contrast_sigma * track.count


def update_appearance_match(track: Track, image: Floats, background: Floats) -> None:
    """Once a track has moved by a stride, compare both places with its kept appearance, and keep the new one.

    Args:
        track: detected in this image; updated.
        image, background: `[3, h, w]`.
    """
    height = image.shape[1]
    last, before = track.last[BOX], track.patch_box.tolist()
    if not any(before):
        new, _ = compare_patches([last], track.patch, image, background)
        track.patch_box, track.patch = np.array(last), new
        return
    top, left, bottom, right = (now - then for now, then in zip(last, before, strict=True))
    if math.hypot((top + bottom) / 2, (left + right) / 2) <= max(STRIDE_SIZES * track.size, MIN_STRIDE_PX / height):
        return
    # Arms, legs and shadows change the box: any of its corners may be what moved along.
    shifts = [(row, column, row, column) for row in (top, bottom) for column in (left, right)]
    there = [[side + by for side, by in zip(before, shift, strict=True)] for shift in shifts]
    new, distances = compare_patches([last, *there, before], track.patch, image, background)
    stayed, went = track.appearance_error
    track.appearance_error = stayed + distances[-1], went + min(distances[:-1])
    track.patch_box, track.patch = np.array(last), new


def compare_patches(
    boxes: Sequence[Sequence[float]], patch: Floats, image: Floats, background: Floats
) -> tuple[Floats, list[float]]:
    """Appearance in the first of some boxes, `[3, PATCH, PATCH]`, and mean squared difference of each from a patch.

    Args:
        boxes: top, left, bottom and right of each, fractions of the height.
        patch: what they are compared with, `[3, PATCH, PATCH]`.
        image, background: `[3, h, w]`.
    """
    height = image.shape[1]
    pixels = np.rint(np.array(boxes) * height).astype(np.int64)
    patches, distances = np.empty((len(boxes), *patch.shape), np.float32), np.empty(len(boxes))
    patch_distance(image, background, pixels, patch, patches, distances)
    return patches[0].copy(), distances.tolist()


def is_rigid_motion(track: Track, light: float) -> bool:
    """Whether the appearance moved along, against a doubt that what is pale cannot settle soon.

    Args:
        light: of the scene, the mean of the background.
    """
    stayed, went = track.appearance_error
    doubt = (RIGIDITY_NOISE * light) ** 2
    return bool(stayed - went - doubt >= MIN_RIGIDITY * (stayed + went + doubt))


def confidence(track: Track) -> float:
    """Rank of a track as an object, 0 to 1: the root of (net displacement / path length) s / (s + `HALF_TRAVEL_SIZES`).

    s is the largest distance from its start in sizes. What never moved has 0. It is not calibrated: no probability.
    """
    path = path_lengths(track)
    s = path.furthest / track.size
    return math.sqrt(path.net / path.length * s / (s + HALF_TRAVEL_SIZES)) if path.length else 0.0


def revoke_confirmation(
    track: Track, clutter: Floats, swinging: Bytes, time: float, dt: float, p: TrackingParams
) -> bool:
    """Whether an object only oscillates: its path was long and it never was far from its start. Or it only grew.

    That is asked every second for `probation_s` seconds after it was confirmed; later it may pace up and down. Where
    something swings it is asked at every step.

    Args:
        clutter: of `ndtorch.tracking.clutter`; only where tracks came and went objects oscillate.
        swinging: 1 where something swings, `[h / 2, w / 2]`.
        dt: seconds of a step.
    """
    age = time - track.confirmed_at + dt / 2
    if not p.min_travel_sizes:
        return False
    swings, full_second = is_swinging(track, swinging), int(age) != int(age - dt)
    if not swings and not (full_second and 1 <= age <= p.probation_s + dt):
        return False
    path = path_lengths(track)
    short = path.furthest < MIN_GROWTH_SIZES * track.size
    return short or (path.furthest < MIN_NET_TRAVEL_RATIO * path.length and (swings or clutter_at(track, clutter) > 0))


def is_swinging(track: Track, swinging: Bytes) -> bool:
    """Whether something swings in most of a track's box."""
    top, left, bottom, right = (max(0, round(side * len(swinging))) for side in track.last[BOX])
    part = swinging[top:bottom, left:right]
    return bool(2 * np.count_nonzero(part) > part.size)


class PathLengths(NamedTuple):
    """Net displacement of a path, its largest so far, and its length, in steps of `PATH_STEP_SIZES`."""

    net: float
    furthest: float
    length: float


def path_lengths(track: Track) -> PathLengths:
    path = track.path[:, PLACE].tolist()
    start = row, column = path[0]
    length, furthest, least = 0.0, 0.0, PATH_STEP_SIZES * track.size
    for down, across in path:
        far = math.hypot(down - row, across - column)
        if far > least:
            length, row, column = length + far, down, across
            furthest = max(furthest, math.hypot(down - start[0], across - start[1]))
    return PathLengths(math.hypot(row - start[0], column - start[1]), furthest, length)
