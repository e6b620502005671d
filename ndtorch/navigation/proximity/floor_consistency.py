"""The floor that both cameras see: correlation straight ahead, and rejection of obstacles behind which floor is seen.

Two farther poles may match as one near obstacle. An obstacle on the floor hides, in its columns of both images, all
floor behind it. If both cameras see one floor there, it is a mismatch. An obstacle that hangs, as a sofa does, hides
floor only farther out; so the farthest rows are compared, and many places that agree are kept all the same.
"""

from __future__ import annotations

import math

import numpy as np

from ndtorch.navigation.proximity._kernels import Floats, FloorGeometry, floor_correlation_of
from ndtorch.navigation.proximity.params import ProximityParams
from ndtorch.navigation.proximity.stereo_match import Obstacles
from ndtorch.navigation.stereo.rig import Rect, StereoRig

MIN_COLUMNS, MIN_PIXELS = 5, 150
"""Rows with fewer columns in both images are left out; with fewer pixels in all the correlation is 0. The second is for
a focal length of 430 pixels, and less in proportion to the area for shorter ones."""

MIN_SIGMA = 0.002
"""Standard deviation of the brightness below which the correlation is 0."""

BEHIND = 1.1
"""Floor is compared from this many times the depth of an obstacle on, and from this depth on, m."""

PAD_PX, GAP_PX, GROUP_MIN_PIXELS = 6, 8, 60
"""Columns to either side of an obstacle that are compared, gap between two obstacles, and fewest pixels."""


def floor_correlation(
    left: Floats, right: Floats, rects: tuple[Rect, Rect], rig: StereoRig, params: ProximityParams
) -> float:
    """Correlation of the floor straight ahead in both images; 0 if too little is seen.

    The disparity of the floor grows by `baseline / height` pixels with every row below the horizon; that of a wall is
    the same in all rows. Cameras that look up or down a little are allowed for.

    Args:
        left, right: subfields `[h, w]` in 0..1.
        rects: their places in the images.
    """
    p, (ours, theirs) = params, rects
    horizon = rig.center[1] - rig.focal * math.tan(rig.pitch)
    rows = np.arange(ours.top, ours.bottom)
    # A row sees (cos - down sin) ahead for every (sin + down cos) down, `down` being rows below the center in focals.
    slant = math.cos(rig.pitch) - (rows - rig.center[1]) / rig.focal * math.sin(rig.pitch)
    depth = rig.focal * rig.camera_height * slant / (np.maximum(rows - horizon, 1.0) * math.cos(rig.pitch))
    rows = rows[(depth >= p.floor_min_depth_m) & (depth <= p.floor_max_depth_m)][::2]
    tilts = np.array([0, *range(-p.max_tilt_px, p.max_tilt_px + 1, 2)])
    geometry = FloorGeometry(
        *(ours.top, ours.left, theirs.top, theirs.left),
        rig.baseline / rig.camera_height * math.cos(rig.pitch),
        horizon,
        rig.center[0],
        p.floor_half_width_m / rig.baseline,
    )
    least = (MIN_COLUMNS, round(MIN_PIXELS * min(1.0, rig.focal / 430.0) ** 2), MIN_SIGMA)
    return float(floor_correlation_of(left, right, rows, tilts, geometry, p.min_floor_correlation, least))


def reject_unoccluded(
    obstacles: Obstacles,
    left: Floats,
    right: Floats,
    rects: tuple[Rect, Rect],
    rig: StereoRig,
    params: ProximityParams,
) -> Obstacles:
    """Obstacles without those behind which floor is seen.

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
        far, ends = float(np.median(depth[group])), (int(column[group].min()), int(column[group].max()))
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
    if count < GROUP_MIN_PIXELS or min(square, right_square) <= count * MIN_SIGMA**2:
        return 0.0
    return both / math.sqrt(square * right_square)
