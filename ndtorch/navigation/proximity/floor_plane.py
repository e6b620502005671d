"""Correlation of what both cameras see straight ahead, as if it were one floor."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.navigation.proximity._kernels import Floats, FloorGeometry, floor_correlation_of
from ndtorch.navigation.proximity.params import ProximityParams
from ndtorch.navigation.stereo.rig import Rect, StereoRig

MIN_COLUMNS, MIN_PIXELS = 5, 150
"""Rows with fewer columns in both images are left out; with fewer pixels in all the correlation is 0. The second is for
a focal length of 430 pixels, and less in proportion to the area for shorter ones."""

MIN_SIGMA = 0.002
"""Standard deviation of the brightness below which the correlation is 0."""


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
