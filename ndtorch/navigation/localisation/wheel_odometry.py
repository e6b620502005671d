"""Wheel odometry, calibrated by and fused with visual odometry in an extended Kalman filter.

Wheels report distance and turn with a scale error that changes from second to second where they slip, a further error
of the turn, and a drift of the heading. Without visual odometry they are used as calibrated so far.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.navigation.localisation.params import OdometryParams
from ndtorch.navigation.localisation.pose_graph import Floats
from ndtorch.navigation.localisation.visual_odometry import Keyframe, Motion, Rows, estimate_motion
from ndtorch.navigation.stereo.rig import StereoRig

WALK_SIGMA = np.array((0.01, 2e-4, math.radians(0.001)))
"""Standard deviations by which scale, bend and drift change from scan to scan."""

SLIP_RATIO, SIGMA_M = 0.02, 1e-4
"""Standard deviation of the distance between two scans: m per metre, and m."""

SLIP_RAD_PER_RAD, SIGMA_RAD = 0.02, 0.001
"""Standard deviation of the turn between two scans: radians per radian, and radians."""


class WheelCalibration(NamedTuple):
    """State.

    Attributes:
        reported: pose by the wheels alone, `[3]`.
        since: distance, m, turn, radians, and duration of driving, s, reported since the last scan, `[3]`.
        base: corrected pose at the last scan, `[3]`.
        errors: scale (share of distance and turn), bend (share of the turn) and drift, radians/s, `[3]`.
        covariance: of the errors, `[3, 3]`.
        keyframe: of the last scan; None if there was none since the car was put where it is.
    """

    reported: Floats
    since: Floats
    base: Floats
    errors: Floats
    covariance: Floats
    keyframe: Keyframe | None


def uncalibrated(pose: Floats, p: OdometryParams) -> WheelCalibration:
    """Wheels before anything was driven."""
    covariance = np.diag(np.square((p.scale_sigma, p.bend_sigma, p.drift_sigma_rad_per_s)))
    return WheelCalibration(pose, np.zeros(3), pose, np.zeros(3), covariance, None)


def moved_to(wheels: WheelCalibration, pose: Floats) -> WheelCalibration:
    """The same calibration at a pose to which the car was carried."""
    return wheels._replace(reported=pose, since=np.zeros(3), base=pose, keyframe=None)


def along_arc(pose: Floats, distance: float, turn: float) -> Floats:
    """A pose `[3]` after an arc, whose chord is taken for its length."""
    x, y, heading = pose.tolist()
    middle = heading + turn / 2
    return np.array((x + distance * math.cos(middle), y + distance * math.sin(middle), heading + turn))


def predict(wheels: WheelCalibration, reported: Floats, seconds: float) -> WheelCalibration:
    """The wheels after a step of dead reckoning to a reported pose `[3]`."""
    x, y, heading = reported.tolist()
    before_x, before_y, before = wheels.reported.tolist()
    turn = heading - before
    middle = before + turn / 2
    distance = (x - before_x) * math.cos(middle) + (y - before_y) * math.sin(middle)
    if abs(distance) < 1e-6 and abs(turn) < 1e-9:
        return wheels._replace(reported=reported)
    return wheels._replace(reported=reported, since=wheels.since + np.array((distance, turn, seconds)))


def calibrated_motion(wheels: WheelCalibration) -> tuple[float, float]:
    """Distance and turn since the last scan, corrected by the calibration."""
    (distance, turn, seconds), (scale, bend, drift) = wheels.since.tolist(), wheels.errors.tolist()
    return distance * (1 - scale), (turn - drift * seconds) * (1 - scale) * (1 - bend)


def calibrated_pose(wheels: WheelCalibration) -> Floats:
    """The pose `[3]` by corrected wheel odometry."""
    return along_arc(wheels.base, *calibrated_motion(wheels))


def is_calibrated(wheels: WheelCalibration, params: OdometryParams) -> bool:
    """Whether visual odometry has calibrated the wheels, as nothing else reduces the variance of the drift."""
    return float(wheels.covariance[2, 2]) < (params.drift_sigma_rad_per_s / 2) ** 2


def update(
    wheels: WheelCalibration, rows: Rows, rig: StereoRig, params: OdometryParams
) -> tuple[WheelCalibration, Floats]:
    """The wheels after a scan of gray rows `[2, W]`, and the variances of distance and turn since the last one."""
    seen = None
    if wheels.keyframe is not None and wheels.since[2] > 0:
        seen = estimate_motion(wheels.keyframe, rows, calibrated_motion(wheels), rig, params.min_matches)
    wheels, motion = fuse(wheels, seen, params)
    return wheels, np.diagonal(motion.covariance).copy()


def fuse(wheels: WheelCalibration, seen: Motion | None, params: OdometryParams) -> tuple[WheelCalibration, Motion]:
    """The wheels, and distance and turn since the last scan, after fusion with visual odometry."""
    p = params
    (distance, turn, seconds), (scale, bend, drift) = wheels.since.tolist(), wheels.errors.tolist()
    predicted = np.array(calibrated_motion(wheels))
    noise = np.diag(((SLIP_RATIO * distance) ** 2 + SIGMA_M**2, (SLIP_RAD_PER_RAD * turn) ** 2 + SIGMA_RAD**2))
    plain = turn - drift * seconds
    jacobian = np.array(
        ((-distance, 0.0, 0.0), (-plain * (1 - bend), -plain * (1 - scale), -seconds * (1 - scale) * (1 - bend)))
    )
    covariance = wheels.covariance
    if seconds:
        covariance = covariance + np.diag(np.square(WALK_SIGMA))
        covariance[0, 0] = min(covariance[0, 0], p.scale_sigma**2)
    total = jacobian @ covariance @ jacobian.T + noise
    errors = wheels.errors
    if seen is None:
        mean, left = predicted, total
    else:
        innovation = seen.mean - predicted
        for _ in range(3):
            off = float(innovation @ np.linalg.solve(total + seen.covariance, innovation))
            if off <= p.slip_gate:
                break
            noise = noise * off / p.slip_gate * 1.5
            total = jacobian @ covariance @ jacobian.T + noise
        inverse = np.linalg.inv(total + seen.covariance)
        mean, left = predicted + total @ inverse @ innovation, total - total @ inverse @ total
        gain = covariance @ jacobian.T @ inverse
        errors, covariance = errors + gain @ innovation, covariance - gain @ jacobian @ covariance
        covariance = (covariance + covariance.T) / 2
    base = along_arc(wheels.base, *mean.tolist())
    wheels = wheels._replace(since=np.zeros(3), base=base, errors=errors, covariance=covariance)
    return wheels, Motion(mean, left)
