"""Where things come and go that never become objects: leaves in the wind, lamps that flicker."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ndtorch.binding.tracking.far_away import tiny
from ndtorch.binding.tracking.figure_params import FigureParams
from ndtorch.binding.tracking.figures import Figure, Numbers
from ndtorch.binding.tracking.regions import Floats

CELL = 1 / 56
"""Side of a cell, as a share of the picture's height."""
BOX = slice(3, 7)


def at_rest(height: int, width: int) -> Floats:
    """Nothing has come and gone yet, `[rows, columns]`.

    Args:
        height, width: of the picture, pixels.
    """
    return np.zeros((round(1 / CELL), max(1, math.ceil(width / height / CELL))), np.float32)


def come_and_gone(
    before: Floats, late: Sequence[Figure], open_: Sequence[Figure], dt: float, p: FigureParams
) -> Floats:
    """How many tracks have come and gone in every cell lately without having become an object, and without one near.

    Pieces and shadows of objects come and go as well, so those near one say nothing about the place.

    Args:
        before: a step ago, `[rows, columns]`.
        late: tracks that were out of sight for too long at this step.
        open_: tracks that are still followed.
        dt: seconds of a step.
        p: constants.
    """
    width = before.shape[1] / before.shape[0]
    gone = [one for one in late if not one.known and one.last_seen - one.first_seen > p.glimpse]
    gone = [one for one in gone if not tiny(one, width, p)]
    if not gone and not before.any():
        return before
    after = before * np.float32(math.exp(-dt / p.forget))
    objects = [one for one in (*late, *open_) if one.known] if gone else []
    for one in gone:
        path = one.path
        if not any(near(path, other, p) for other in objects):
            cells = np.zeros(after.shape, bool)
            for box in path[:, BOX]:
                cells[window(box)] = True
            after[cells] += 1
    return after


def near(path: Numbers, other: Figure, p: FigureParams) -> bool:
    """Whether an object was within `near` of its size of a track while that was in sight, or shortly before or after.

    Args:
        path: sightings of the track, `[n, 10]`.
        other: the object.
        p: constants.
    """
    first, last = path[0, 0] - p.shortly, path[-1, 0] + p.shortly
    its = other.path
    its = its[(its[:, 0] >= first) & (its[:, 0] <= last)]
    (top, left), (bottom, right) = path[:, 3:5].min(0), path[:, 5:7].max(0)
    gap = p.near * other.size
    beside = (its[:, 3] - gap < bottom) & (its[:, 5] + gap > top) & (its[:, 4] - gap < right) & (its[:, 6] + gap > left)
    return bool(beside.any())


def restless(one: Figure, gone: Floats) -> float:
    """How many have come and gone where a track is now, in the mean over its box.

    Args:
        one: the track.
        gone: of `come_and_gone`.
    """
    return float(gone[window(np.array(one.last[BOX]))].mean())


def window(box: Numbers) -> tuple[slice, slice]:
    """The cells of a box, at least one; top, left, bottom and right are shares of the height."""
    top, left = (max(0, int(side / CELL)) for side in box[:2].tolist())
    bottom, right = (max(1, math.ceil(side / CELL)) for side in box[2:].tolist())
    return slice(min(top, bottom - 1), bottom), slice(min(left, right - 1), right)
