"""Extended Kalman filter of the pose and of the remaining odometry errors: x, y, heading, scale, bend and drift."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.navigation.localisation.params import LocaliserParams
from ndtorch.navigation.localisation.pose_graph import Floats, information_matrix

SIGMA_M, SIGMA_RAD = 0.001, 0.0003
"""Standard deviations of odometry between two scans, beside those of its fusion."""

WALK_SIGMA = np.array((5e-5, 5e-5, math.radians(0.0003)))
"""Standard deviations by which scale, bend and drift change from scan to scan."""

RESIDUAL_SCALE = 0.1
"""Factor of the deviations of scale, bend and drift once visual odometry has calibrated the wheels: the error of a scan
match is then mostly the error of the match."""


def predict(
    covariance: Floats,
    driven: float,
    turned: float,
    variance: Floats,
    seconds: float,
    heading: float,
    params: LocaliserParams,
    calibrated: bool = False,
) -> Floats:
    """The covariance `[6, 6]` after driving on.

    Args:
        driven, turned: distance, m, and turn, radians.
        variance: of both, `[2]`.
        seconds: duration of driving.
        heading: after it.
        calibrated: whether visual odometry has calibrated the wheels.
    """
    p, middle = params, heading - turned / 2
    residual = RESIDUAL_SCALE if calibrated else 1.0
    cos, sin = driven * math.cos(middle), driven * math.sin(middle)
    step = np.eye(6)
    step[0, 2], step[1, 2] = -sin, cos
    step[0, 3], step[1, 3] = -cos, -sin
    step[2, 4], step[2, 5] = -turned, -seconds
    step[:2, 4:] = step[:2, 2:3] * step[2, 4:] / 2
    noise = np.zeros(6)
    noise[:2] = SIGMA_M**2 + variance[0]
    noise[2] = SIGMA_RAD**2 + variance[1]
    if seconds:
        noise[3:] = np.square(residual * WALK_SIGMA)
    covariance = step @ covariance @ step.T + np.diag(noise)
    if calibrated:
        most = residual * np.array((p.scale_sigma, p.bend_sigma, p.drift_sigma_rad_per_s))
        limit = np.ones(6)
        limit[3:] = np.minimum(1.0, most / np.sqrt(covariance.diagonal()[3:]).clip(1e-12))
        covariance = covariance * limit * limit[:, None]
    return covariance


def update(
    covariance: Floats, innovation: Floats, information: Floats, params: LocaliserParams
) -> tuple[Floats, Floats]:
    """The correction `[6]` by a scan match and the covariance after it.

    Args:
        innovation: matched minus predicted pose, `[3]`.
        information: of the match, see `ScanMatch`.
    """
    p = params
    scaled = information_matrix(information) * p.information_scale + 1e-3 * np.eye(3)
    noise = np.linalg.inv(scaled) + np.diag((p.min_sigma_m**2, p.min_sigma_m**2, p.min_sigma_rad**2))
    total = covariance[:3, :3] + noise
    distance = float(innovation @ np.linalg.solve(total, innovation))
    if distance > p.slip_gate:
        covariance = covariance.copy()
        covariance[:3, :3] *= distance / p.slip_gate
        total = covariance[:3, :3] + noise
    gain = np.linalg.solve(total, covariance[:3]).T
    covariance = covariance - gain @ covariance[:3]
    return gain @ innovation, (covariance + covariance.T) / 2
