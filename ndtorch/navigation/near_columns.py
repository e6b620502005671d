"""Whether floor is seen where a near thing would hide it: two poles farther away may match as one that is near.

What stands on the floor hides, in its own columns of both images, all floor behind it. Where both eyes see one floor
there, nothing stands. What hangs, as a sofa does, hides floor only farther out, so near things are asked about the
farthest rows, and many places that agree are believed all the same.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ndtorch.navigation.near_params import NearParams
from ndtorch.navigation.near_things import Near
from ndtorch.navigation.rig import Rect, StereoRig

Floats = npt.NDArray[np.float32]

BEHIND = 1.1
"""Floor is asked for from this many times the depth of a thing on, and from this depth on, m."""

PAD, APART, NARROWEST = 6, 8, 60
"""Columns to either side of a thing that are compared, columns between places of one thing, and fewest pixels."""


def without_unseen(
    near: Near, left: Floats, right: Floats, rects: tuple[Rect, Rect], rig: StereoRig, params: NearParams
) -> Near:
    """Near things without those behind which floor is seen.

    Only what is nearer than `through_to`, or in the middle of the floor right ahead, can be told so.

    Args:
        near: what is believed so far, body frame.
        left, right: the subfields `[h, w]` in 0..1.
        rects: where they are.
    """
    p = params
    if not 0 < len(near.x) < p.few:
        return near
    depth = near.x - rig.forward
    column = (rig.width - 1) / 2 + rig.focal * (rig.baseline / 2 - near.y) / depth
    order = np.argsort(column)
    parts = np.flatnonzero((np.diff(column[order]) > APART) | (np.abs(np.diff(depth[order])) > 0.15 * depth[order][1:]))
    kept = np.ones(len(near.x), bool)
    for part in np.split(order, parts + 1):
        far, aside = float(np.median(depth[part])), float(np.abs(np.median(near.y[part])))
        if far < p.through_to or (far >= p.floor_from and aside <= p.floor_beside):
            ends = (int(column[part].min()), int(column[part].max()))
            kept[part] = floor_behind(far, ends, left, right, rects, rig) < p.unbroken
    return Near(near.x[kept], near.y[kept])


def floor_behind(
    depth: float, columns: tuple[int, int], left: Floats, right: Floats, rects: tuple[Rect, Rect], rig: StereoRig
) -> float:
    """How much what both eyes see in these columns of the left image looks like the floor beyond `depth`, as
    `floor_likeness`; 0 where too little is seen.

    Args:
        depth: of the thing that would hide it, m.
        columns: first and last.
        left, right, rects: as `without_unseen`.
    """
    ours, theirs = rects
    horizon = (rig.height - 1) / 2 - rig.focal * math.tan(rig.pitch)
    rows = np.arange(ours.top, ours.bottom)
    rows = rows[rig.focal * rig.camera_height / np.maximum(rows - horizon, 1.0) > max(BEHIND * depth, BEHIND)]
    wide = np.arange(max(ours.left, columns[0] - PAD), min(ours.right, columns[1] + PAD + 1))
    both, squares, others, count = 0.0, 0.0, 0.0, 0
    for row in rows.tolist():
        shift = round(rig.baseline / rig.camera_height * (row - horizon))
        place = wide[(wide - shift >= theirs.left) & (wide - shift < theirs.right)]
        if len(place) < PAD:
            continue
        a, b = left[row - ours.top, place - ours.left], right[row - theirs.top, place - shift - theirs.left]
        a, b = a - a.mean(), b - b.mean()
        both, squares, others = both + float(a @ b), squares + float(a @ a), others + float(b @ b)
        count += len(place)
    if count < NARROWEST or min(squares, others) <= count * NearParams.blank**2:
        return 0.0
    return both / math.sqrt(squares * others)
