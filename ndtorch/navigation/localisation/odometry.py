"""Wheel odometry, calibrated by and fused with visual odometry in an extended Kalman filter.

Wheels report distance and turn with a scale error that changes from second to second where they slip, a further error
of the turn, and a drift of the heading. Visual odometry searches both present rows for the points that were ranged in
the keyframe, and finds the distance along an arc and the turn that explain their columns, as in [Nistér, Naroditsky &
Bergen 2004] but in one plane. Without it the wheels are used as calibrated so far.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.navigation.localisation._kernels import Cells, Floats, Stereo, row_visual_odometry
from ndtorch.navigation.localisation.ndt import Scan
from ndtorch.navigation.stereo.rig import StereoRig

SCALE_SIGMA, BEND_SIGMA, DRIFT_SIGMA = 0.1, 0.03, math.radians(0.2)
"""Prior standard deviations of the wheels' scale error, of their turn error (ratios), and of the drift, radians/s."""

WALK_SIGMA = np.array((0.01, 2e-4, math.radians(0.001)))
"""Standard deviations by which these change from scan to scan."""

SLIP_RATIO, SIGMA_M = 0.02, 1e-4
"""Standard deviation of the distance between two scans: m per metre, and m."""

SLIP_RAD_PER_RAD, SIGMA_RAD = 0.02, 0.001
"""Standard deviation of the turn between two scans: radians per radian, and radians."""

SLIP_GATE = 9.0
"""Wheels count as slipping beyond this squared Mahalanobis distance from visual odometry."""

MAX_ERROR, MIN_INLIERS, MIN_INLIER_RATIO = 1.5, 2, 0.7
"""Mean squared error of visual inliers in standard deviations, at most; their number and ratio, at least."""

MIN_SIGMA = np.array((0.001, 0.0001))
"""Standard deviations of visual distance, m, and turn, radians, at best."""


class Motion(NamedTuple):
    """Distance, m, and turn, radians, `[2]`, and their covariance `[2, 2]`."""

    mean: Floats
    covariance: Floats


class OdometryState(NamedTuple):
    """State of odometry.

    Attributes:
        reported: pose by the wheels alone, `[3]`.
        since: distance, m, turn, radians, and duration of driving, s, reported since the last scan, `[3]`.
        base: corrected pose at the last scan, `[3]`.
        errors: scale (ratio of distance and turn), bend (ratio of the turn) and drift, radians/s, `[3]`.
        covariance: of the errors, `[3, 3]`.
        rows, points: gray rows of the last scan, `[2, W]`, and the points ranged in them, m, `[2, n]`; both are empty
            before the first scan.
    """

    reported: Floats
    since: Floats
    base: Floats
    errors: Floats
    covariance: Floats
    rows: Cells
    points: Floats


def start_odometry(pose: Floats) -> OdometryState:
    """Wheels at a pose before anything was driven."""
    covariance = np.diag(np.square((SCALE_SIGMA, BEND_SIGMA, DRIFT_SIGMA)))
    nothing = np.zeros((2, 0), np.float32), np.zeros((2, 0))
    return OdometryState(pose, np.zeros(3), pose, np.zeros(3), covariance, *nothing)


def advance(state: OdometryState, reported: Floats, seconds: float) -> OdometryState:
    """The state after a step in which the wheels reported to have come to a pose `[3]`."""
    (x, y), turn = reported[:2] - state.reported[:2], float(reported[2] - state.reported[2])
    middle = state.reported[2] + turn / 2
    distance = float(x * math.cos(middle) + y * math.sin(middle))
    state = state._replace(reported=reported)
    if abs(distance) < 1e-6 and abs(turn) < 1e-9:
        return state
    return state._replace(since=state.since + np.array((distance, turn, seconds)))


def motion_since_scan(state: OdometryState) -> Floats:
    """Distance and turn since the last scan, corrected by the calibration, `[2]`."""
    (distance, turn, seconds), (scale, bend, drift) = state.since.tolist(), state.errors.tolist()
    return np.array((distance * (1 - scale), (turn - drift * seconds) * (1 - scale) * (1 - bend)))


def fused_pose(state: OdometryState) -> Floats:
    """The present pose by fused odometry, `[3]`."""
    return along_arc(state.base, motion_since_scan(state))


def along_arc(pose: Floats, motion: Floats) -> Floats:
    """A pose `[3]` after a distance and a turn; the chord of the arc is taken for its length."""
    distance, turn = motion.tolist()
    middle = pose[2] + turn / 2
    step: Floats = np.array((distance * math.cos(middle), distance * math.sin(middle), turn))
    return pose + step


def visual_motion(state: OdometryState, rows: Cells, rig: StereoRig) -> Motion | None:
    """Distance and turn since the last scan by gray rows `[2, W]`; None with too few matches or too large errors."""
    if not state.points.size:
        return None
    stereo = Stereo(rig.baseline, rig.focal, rig.center[0], rig.forward)
    distance, turn = motion_since_scan(state).tolist()
    match = row_visual_odometry(state.rows, rows, *state.points, (distance, turn), stereo)
    if match.inliers < max(MIN_INLIERS, MIN_INLIER_RATIO * match.matches) or match.error > MAX_ERROR:
        return None
    information = np.array(((match.dd, match.dt), (match.dt, match.tt))) + 1e-3 * np.eye(2)
    covariance: Floats = np.linalg.inv(information).astype(np.float64) + np.diag(MIN_SIGMA**2)
    return Motion(np.array((match.distance, match.turn)), covariance)


def fuse(state: OdometryState, visual: Motion | None) -> tuple[OdometryState, Floats]:
    """The state at a scan, and the variances `[2]` of distance and turn since the last one."""
    (distance, turn, seconds), (scale, bend, drift) = state.since.tolist(), state.errors.tolist()
    motion, errors, covariance = motion_since_scan(state), state.errors, state.covariance
    noise = np.diag(((SLIP_RATIO * distance) ** 2 + SIGMA_M**2, (SLIP_RAD_PER_RAD * turn) ** 2 + SIGMA_RAD**2))
    plain = turn - drift * seconds
    jacobian = np.array(
        ((-distance, 0.0, 0.0), (-plain * (1 - bend), -plain * (1 - scale), -seconds * (1 - scale) * (1 - bend)))
    )
    if seconds:
        covariance = covariance + np.diag(np.square(WALK_SIGMA))
        covariance[0, 0] = min(covariance[0, 0], SCALE_SIGMA**2)
    total = jacobian @ covariance @ jacobian.T + noise
    variance = np.diagonal(total)
    if visual is not None:
        innovation = visual.mean - motion
        for _ in range(3):
            off = float(innovation @ np.linalg.solve(total + visual.covariance, innovation))
            if off <= SLIP_GATE:
                break
            noise = noise * off / SLIP_GATE * 1.5
            total = jacobian @ covariance @ jacobian.T + noise
        inverse = np.linalg.inv(total + visual.covariance)
        motion, variance = motion + total @ inverse @ innovation, np.diagonal(total - total @ inverse @ total)
        gain = covariance @ jacobian.T @ inverse
        errors, covariance = errors + gain @ innovation, covariance - gain @ jacobian @ covariance
        covariance = (covariance + covariance.T) / 2
    base = along_arc(state.base, motion)
    return state._replace(since=np.zeros(3), base=base, errors=errors, covariance=covariance), variance.copy()


def with_keyframe(state: OdometryState, rows: Cells, scan: Scan) -> OdometryState:
    """The state from whose rows `[2, W]`, in which a scan was ranged, visual odometry goes on."""
    return state._replace(rows=rows, points=np.stack((scan.x, scan.y)))
