"""Whether a track is a thing: it stands out far from the noise, or moves as a whole and leaves its old place."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import FOLLOWED, PATCH, Figure
from ndtorch.binding.tracking.regions import Floats
from ndtorch.kernels.look_at import look_at
from ndtorch.kernels.switch import kernels_wanted


def patch_of(picture: Floats, ground: Floats, box: npt.NDArray[np.int64]) -> Floats:
    """The difference from the ground in a box, at a size that all tracks share, `[3, PATCH, PATCH]`.

    Args:
        picture, ground: `[3, h, w]`.
        box: top, left, bottom and right, pixels; what lies outside the picture is left out.
    """
    import cv2

    height, width = picture.shape[1:]
    top, left = min(max(box[0], 0), height - 1), min(max(box[1], 0), width - 1)
    bottom, right = min(max(box[2], top + 1), height), min(max(box[3], left + 1), width)
    apart = picture[:, top:bottom, left:right] - ground[:, top:bottom, left:right]
    # Means where it shrinks: single pixels would be noise.
    how = cv2.INTER_AREA if min(apart.shape[1:]) > PATCH else cv2.INTER_LINEAR
    return np.stack([np.asarray(cv2.resize(plane, (PATCH, PATCH), interpolation=how), np.float32) for plane in apart])


def clear(one: Figure, p: FigureParams) -> bool:
    """Whether a track stood out so much, all its sightings together, that it is no chance piece of anything."""
    return one.sure >= p.clear * (len(one.before) + len(one.late))


def look_again(one: Figure, picture: Floats, ground: Floats, p: FigureParams) -> None:
    """Once a track has gone on by `stride`, compare what is at both places with what it looked like before.

    Pieces that come and go side by side, leaves that sway, and blocks of a codec shift the middle of a region, but what
    was there stays there. The squared differences of both are summed over the track's life, so that what stands out
    much counts for more.

    Args:
        one: the track, seen in this picture; is changed.
        picture, ground: `[3, h, w]`.
        p: constants.
    """
    height = picture.shape[1]
    last, before = one.last[3:7], one.looked.tolist()
    if not any(before):
        new, _ = seen_at([last], one.patch, picture, ground)
        one.looked, one.patch = np.array(last), new
        return
    top, left, bottom, right = (now - then for now, then in zip(last, before, strict=True))
    if math.hypot((top + bottom) / 2, (left + right) / 2) <= max(p.stride * one.size, p.least_stride / height):
        return
    # Arms, legs and shadows change the box: any of its corners may be what went along.
    ways = [(row, column, row, column) for row in (top, bottom) for column in (left, right)]
    there = [[side + by for side, by in zip(before, way, strict=True)] for way in ways]
    new, apart = seen_at([last, *there, before], one.patch, picture, ground)
    one.unlike = one.unlike + np.array((apart[-1], min(apart[:-1])))
    one.looked, one.patch = np.array(last), new


def seen_at(
    boxes: Sequence[Sequence[float]], patch: Floats, picture: Floats, ground: Floats
) -> tuple[Floats, list[float]]:
    """What is in the first of some boxes, `[3, PATCH, PATCH]`, and how much that of each box differs from a patch.

    Args:
        boxes: top, left, bottom and right of each, shares of the height.
        patch: what they are compared with, `[3, PATCH, PATCH]`.
        picture, ground: `[3, h, w]`.
    """
    height = picture.shape[1]
    pixels = np.array([[round(side * height) for side in box] for box in boxes])
    if kernels_wanted():
        looks, apart = np.empty((len(boxes), *patch.shape), np.float32), np.empty(len(boxes))
        look_at(picture, ground, pixels, patch, looks, apart)
        return looks[0].copy(), apart.tolist()
    seen = [patch_of(picture, ground, box) for box in pixels]
    return seen[0], [float(((one - patch) ** 2).mean()) for one in seen]


def moves_as_a_whole(one: Figure, light: float, p: FigureParams) -> bool:
    """Whether what was seen at its places says so, against a doubt that is larger than what is pale can settle soon.

    Args:
        one: the track.
        light: of the scene, the mean of the ground.
        p: constants.
    """
    stayed, went = one.unlike.tolist()
    doubt = (p.doubt * light) ** 2
    return bool(stayed - went - doubt >= p.whole * (stayed + went + doubt))


def swings(one: Figure, p: FigureParams) -> bool:
    """Whether what it looked like stayed behind wherever it went, and its way leads to and fro: leaves in the wind.

    A leg of one who walks stays behind as well, but its way is straight.

    Args:
        one: the track.
        p: constants.
    """
    stayed, went = one.unlike.tolist()
    return bool(stayed - went < -p.behind * (stayed + went)) and straightness(one, p) < p.straight


def straightness(one: Figure, p: FigureParams) -> float:
    """How far a track got, as a share of the length of its way in steps of `step` of its size; 1 before the first."""
    got, _, length = way_of(one, p)
    return got / length if length else 1.0


def taken_back(one: Figure, stirred: bool, time: float, dt: float, p: FigureParams) -> bool:
    """Whether an object turns out to go to and fro: its way was long, and it never was far from where it began. Or it
    did not get far for its size, since it only grew.

    That is asked every second for `trial` seconds after it became an object. Later one may pace up and down.

    Args:
        one: the object.
        stirred: whether things came and went where it is; only there objects are told that go to and fro.
        time: seconds.
        dt: seconds of a step.
        p: constants.
    """
    age = time - one.since + dt / 2
    if not p.travel or age > p.trial + dt or int(age) == int(age - dt) or age < 1:
        return False
    _, furthest, length = way_of(one, p)
    return furthest < p.grown * one.size or (stirred and furthest < p.swing * length)


def way_of(one: Figure, p: FigureParams) -> tuple[float, float, float]:
    """How far a track is from where it began, how far it was at most, and the length of its way, in steps."""
    way = one.path[:, FOLLOWED].tolist()
    start = row, column = way[0]
    length, furthest, least = 0.0, 0.0, p.step * one.size
    for down, across in way:
        far = math.hypot(down - row, across - column)
        if far > least:
            length, row, column = length + far, down, across
            furthest = max(furthest, math.hypot(down - start[0], across - start[1]))
    return math.hypot(row - start[0], column - start[1]), furthest, length
