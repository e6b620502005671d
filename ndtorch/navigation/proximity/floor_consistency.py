"""Rejection of obstacles behind which floor is seen: two farther poles may match as one near obstacle.

An obstacle on the floor hides, in its columns of both images, all floor behind it. If both cameras see one floor there,
it is a mismatch. An obstacle that hangs, as a sofa does, hides floor only farther out; so the farthest rows are
compared, and many places that agree are kept all the same.
"""

from __future__ import annotations

import math

import numpy as np

from ndtorch.navigation.proximity._kernels import Floats
from ndtorch.navigation.proximity.floor_plane import MIN_SIGMA
from ndtorch.navigation.proximity.params import ProximityParams
from ndtorch.navigation.proximity.stereo_match import Obstacles
from ndtorch.navigation.stereo.rig import Rect, StereoRig

BEHIND = 1.1
"""Floor is compared from this many times the depth of an obstacle on, and from this depth on, m."""

PAD_PX, GAP_PX, MIN_PIXELS = 6, 8, 60
"""Columns to either side of an obstacle that are compared, gap between two obstacles, and fewest pixels."""


def reject_unoccluded(
    obstacles: Obstacles,
    left: Floats,
    right: Floats,
    rects: tuple[Rect, Rect],
    rig: StereoRig,
    params: ProximityParams,
) -> Obstacles:
    """Obstacles without those behind which floor is seen.

    Only those nearer than `floor_check_depth_m`, or in the middle of the compared floor, can be rejected.

    Args:
        obstacles: in the body frame.
        left, right: subfields `[h, w]` in 0..1.
        rects: their places in the images.
    """
    p = params
    if not 0 < len(obstacles.x) < p.mismatch_max_places:
        return obstacles
    depth = obstacles.x - rig.forward
    column = rig.center[0] + rig.focal * (rig.baseline / 2 - obstacles.y) / depth
    order = np.argsort(column)
    gap = (np.diff(column[order]) > GAP_PX) | (np.abs(np.diff(depth[order])) > 0.15 * depth[order][1:])
    kept = np.ones(len(obstacles.x), bool)
    for group in np.split(order, np.flatnonzero(gap) + 1):
        far, aside = float(np.median(depth[group])), float(np.abs(np.median(obstacles.y[group])))
        if far < p.floor_check_depth_m or (far >= p.floor_min_depth_m and aside <= p.floor_half_width_m):
            ends = (int(column[group].min()), int(column[group].max()))
            kept[group] = correlation_behind(far, ends, left, right, rects, rig) < p.unbroken_correlation
    return Obstacles(obstacles.x[kept], obstacles.y[kept])


def correlation_behind(
    depth: float, columns: tuple[int, int], left: Floats, right: Floats, rects: tuple[Rect, Rect], rig: StereoRig
) -> float:
    """Correlation of the floor behind an obstacle, as `floor_correlation`; 0 if too little is seen.

    Args:
        depth: of the obstacle, m.
        columns: its first and last in the left image.
        left, right, rects: as in `reject_unoccluded`.
    """
    ours, theirs = rects
    horizon = rig.center[1] - rig.focal * math.tan(rig.pitch)
    rows = np.arange(ours.top, ours.bottom)
    rows = rows[rig.focal * rig.camera_height / np.maximum(rows - horizon, 1.0) > max(BEHIND * depth, BEHIND)]
    wide = np.arange(max(ours.left, columns[0] - PAD_PX), min(ours.right, columns[1] + PAD_PX + 1))
    both, square, right_square, count = 0.0, 0.0, 0.0, 0
    for row in rows.tolist():
        shift = round(rig.baseline / rig.camera_height * (row - horizon))
        place = wide[(wide - shift >= theirs.left) & (wide - shift < theirs.right)]
        if len(place) < PAD_PX:
            continue
        a, b = left[row - ours.top, place - ours.left], right[row - theirs.top, place - shift - theirs.left]
        a, b = a - a.mean(), b - b.mean()
        both, square, right_square = both + float(a @ b), square + float(a @ a), right_square + float(b @ b)
        count += len(place)
    if count < MIN_PIXELS or min(square, right_square) <= count * MIN_SIGMA**2:
        return 0.0
    return both / math.sqrt(square * right_square)
