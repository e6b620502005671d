"""Visual odometry from the two horizon rows: distance and turn between a keyframe and the present rows.

The points ranged in the keyframe are searched for in both present rows; Gauss-Newton finds the distance along an arc
and the turn that explain their columns, as in [Nistér, Naroditsky & Bergen 2004] but in one plane. It does not depend
on the wheels and so detects their slip.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.kernels.load import kernel
from ndtorch.navigation.localisation.ndt import Scan
from ndtorch.navigation.localisation.pose_graph import Floats
from ndtorch.navigation.rig import StereoRig

PATCH_HALF_PX = 8
"""Pixels compared to either side of a point."""

SEARCH_PX = 24
"""Points are searched for within this distance of their predicted column."""

MAX_DIFFERENCE = 0.05
"""Mean absolute difference of a match, for intensities 0..1, at most."""

RATIO = 0.8
"""A match must differ by less than this share of the best one elsewhere."""

COLUMN_SIGMA_PX, DISPARITY_SIGMA_PX = 0.39, 0.3
"""Standard deviations of the column and of the disparity of a point."""

OUTLIER_GATE = 6.0
"""Squared error, in standard deviations, at which a point has a quarter of its weight."""

ITERATIONS = 6
"""Gauss-Newton iterations."""

MAX_ERROR = 0.8
"""Mean squared error of the inliers, in standard deviations, at most."""

MIN_INLIER_RATIO = 0.85
"""Share of the matched points that must be inliers."""

MIN_SIGMA_M, MIN_SIGMA_RAD = 0.001, 0.0001
"""Standard deviations of an estimate at best."""

Rows = npt.NDArray[np.float32]


class Keyframe(NamedTuple):
    """Gray rows `[2, W]` and the points ranged in them, m, `[n, 2]`."""

    rows: Rows
    points: Floats


class Motion(NamedTuple):
    """Distance, m, and turn, radians, `[2]`, and their covariance `[2, 2]`."""

    mean: Floats
    covariance: Floats


def keyframe(rows: Rows, scan: Scan) -> Keyframe:
    """A keyframe of gray rows `[2, W]` and the scan made of them."""
    return Keyframe(rows, np.stack((scan.x, scan.y), -1))


def estimate_motion(
    before: Keyframe, rows: Rows, predicted: tuple[float, float], rig: StereoRig, min_matches: int
) -> Motion | None:
    """Distance and turn since a keyframe; None with too few matches or too large errors.

    Args:
        rows: present gray rows, `[2, W]`.
        predicted: distance and turn, m and radians.
        min_matches: matched places in the two rows, at least.
    """
    if len(before.points) * 2 < min_matches or before.rows.shape != rows.shape:
        return None
    out = np.zeros(8)
    x, y = np.ascontiguousarray(before.points.T)
    kernel("row_motion").run(
        before.rows,
        rows,
        x,
        y,
        predicted,
        (rig.baseline, rig.focal, rig.center[0], rig.forward),
        (PATCH_HALF_PX, SEARCH_PX, MAX_DIFFERENCE, RATIO),
        (COLUMN_SIGMA_PX, DISPARITY_SIGMA_PX, OUTLIER_GATE, ITERATIONS),
        out,
    )
    inliers, error, matches = out[5:]
    if inliers < max(min_matches, MIN_INLIER_RATIO * matches) or error > MAX_ERROR:
        return None
    information = out[[2, 3, 3, 4]].reshape(2, 2) + 1e-3 * np.eye(2)
    noise = np.diag((MIN_SIGMA_M**2, MIN_SIGMA_RAD**2))
    return Motion(out[:2].copy(), np.asarray(np.linalg.inv(information) + noise, np.float64))
