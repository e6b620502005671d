"""Visual odometry from the two horizon rows: distance and turn between a keyframe and the present rows.

The points ranged in the keyframe are searched for in both present rows; Gauss-Newton finds the distance along an arc
and the turn that explain their columns, as in [Nistér, Naroditsky & Bergen 2004] but in one plane. It does not depend
on the wheels and so detects their slip.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.navigation.localisation._kernels import Stereo, row_visual_odometry
from ndtorch.navigation.localisation.ndt import Scan
from ndtorch.navigation.localisation.pose_graph import Floats
from ndtorch.navigation.stereo.rig import StereoRig

MAX_ERROR = 1.5
"""Mean squared error of the inliers, in standard deviations, at most."""

MIN_INLIER_RATIO = 0.7
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
    x, y = np.ascontiguousarray(before.points.T)
    stereo = Stereo(rig.baseline, rig.focal, rig.center[0], rig.forward)
    found = row_visual_odometry(before.rows, rows, x, y, predicted, stereo)
    if found.inliers < max(min_matches, MIN_INLIER_RATIO * found.matches) or found.error > MAX_ERROR:
        return None
    information = np.array(((found.dd, found.dt), (found.dt, found.tt))) + 1e-3 * np.eye(2)
    covariance = np.linalg.inv(information) + np.diag((MIN_SIGMA_M**2, MIN_SIGMA_RAD**2))
    return Motion(np.array(found[:2]), np.asarray(covariance, np.float64))
