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

from ndtorch.navigation.localisation.ndt import MAX_STEP, Cells, Floats, Scan
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.utils.jit import jit

Stereo = tuple[float, float, float, float]
"""Baseline, m, focal length and middle column, pixels, and place of the cameras ahead of the body's origin, m."""

SCALE_SIGMA, BEND_SIGMA, DRIFT_SIGMA = 0.1, 0.03, math.radians(0.2)
"""Prior standard deviations of the wheels' scale error, of their turn error (ratios), and of the drift, radians/s."""

WALK_SIGMA = np.array((0.01, 2e-4, math.radians(0.001)))
"""Standard deviations by which these change from scan to scan."""

SLIP_RATIO, SIGMA_M = 0.02, 1e-4  # standard deviation of the distance between two scans: m per metre, and m

SLIP_RAD_PER_RAD, SIGMA_RAD = 0.02, 0.001
"""Standard deviation of the turn between two scans: radians per radian, and radians."""

SLIP_GATE = 9.0  # wheels count as slipping beyond this squared Mahalanobis distance from visual odometry

MAX_ERROR, MIN_INLIERS, MIN_INLIER_RATIO = 1.5, 2, 0.7
"""Mean squared error of visual inliers in standard deviations, at most; their number and ratio, at least."""

MIN_SIGMA = np.array((0.001, 0.0001))
"""Standard deviations of visual distance, m, and turn, radians, at best."""

PATCH_HALF_PX = 8  # pixels compared to either side of a point
SEARCH_PX = 24  # points are searched for within this distance of their predicted column
MAX_DIFFERENCE = 0.05  # mean absolute difference of a match, for intensities 0..1, at most

UNIQUENESS_RATIO, NEIGHBOURS_PX = 0.8, 2
"""A match must differ by less than this ratio of the best one farther away than the neighbours."""

COLUMN_SIGMA_PX, DISPARITY_SIGMA_PX = 0.39, 0.3
"""Standard deviations of the column and of the disparity of a point."""

MOTION_GATE = 6.0  # squared error, in standard deviations, at which a point has a quarter of its weight

MOTION_ITERATIONS, GATE_FACTORS = 6, (400.0, 60.0, 9.0)
"""Gauss-Newton iterations, and factors of the gate in the first ones: the prediction may be some pixels off."""


class Motion(NamedTuple):
    """Distance, m, and turn, radians, `[2]`, and their covariance `[2, 2]`."""

    mean: Floats
    covariance: Floats


class OdometryState(NamedTuple):
    """State of odometry."""

    reported: Floats  # pose by the wheels alone, `[3]`
    # distance, m, turn, radians, and duration of driving, s, reported since the last scan, `[3]`
    since: Floats
    base: Floats  # corrected pose at the last scan, `[3]`
    # scale (ratio of distance and turn), bend (ratio of the turn) and drift, radians/s, `[3]`
    errors: Floats
    covariance: Floats  # of the errors, `[3, 3]`
    # rows, points: gray rows of the last scan, `[2, W]`, and the points ranged in them, m, `[2, n]`; both
    # are empty before the first scan
    rows: Cells
    points: Floats


def start_odometry(pose: Floats) -> OdometryState:
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
    stereo = float(rig.baseline), float(rig.focal), float(rig.center[0]), float(rig.forward)
    distance, turn = motion_since_scan(state).tolist()
    mean, information, agree = row_visual_odometry(state.rows, rows, *state.points, (distance, turn), stereo)
    if not agree:
        return None
    covariance = np.linalg.inv(information + 1e-3 * np.eye(2)) + np.diag(MIN_SIGMA**2)
    return Motion(mean, covariance.astype(np.float64))


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


@jit
def row_visual_odometry(
    before: Cells, rows: Cells, x: Floats, y: Floats, predicted: tuple[float, float], stereo: Stereo
) -> tuple[Floats, Floats, bool]:
    """Distance along an arc and turn between two row pairs `[2, W]`, left first, `[2]`, their information `[2, 2]`, and
    whether enough columns agree on them.

    The surroundings of every point in the first rows are searched for in the second ones. Gauss-Newton finds the motion
    that explains the columns found, weighted by 1 / (1 + e^2 / gate)^2 for an error of e standard deviations.

    Args:
        x, y: points in the body frame of the first rows, m, `[n]`.
        predicted: distance and turn, m and radians.
    """
    columns = find_columns(before, rows, x, y, predicted, stereo)
    (distance, turn), (baseline, focal, center, forward) = predicted, stereo
    dd = dt = tt = error = 0.0
    inliers = 0
    for step in range(MOTION_ITERATIONS):
        dd = dt = tt = gd = gt = squares = 0.0
        inliers = 0
        cos, sin = math.cos(turn / 2), math.sin(turn / 2)
        limit = MOTION_GATE * (GATE_FACTORS[step] if step < len(GATE_FACTORS) else 1.0)
        for k in range(len(x)):
            ahead, left = from_camera(x[k], y[k], distance, turn, forward)
            if ahead <= 0:
                continue
            ahead_t, left_t = left - distance * sin / 2, -ahead - forward - distance * cos / 2
            for camera in range(2):
                if columns[k, camera] < 0:
                    continue
                side = baseline / 2 if camera == 0 else -baseline / 2
                old, new = (y[k] - side) / (x[k] - forward), (left - side) / ahead
                # The shift that the turn does not explain comes from the distance, and is as uncertain as the range.
                by_distance = abs(focal * (old - new) - focal * turn * (1 + old * old))
                ratio = by_distance * (x[k] - forward) / (focal * baseline)
                variance = COLUMN_SIGMA_PX**2 + (DISPARITY_SIGMA_PX * ratio) ** 2
                by_d = -focal * (sin + new * cos) / ahead
                by_t = -focal * (left_t - new * ahead_t) / ahead
                off = columns[k, camera] - (center - focal * new)
                square = off * off / variance
                weight = 1 / variance / (1 + square / limit) ** 2
                dd, dt, tt = dd + weight * by_d * by_d, dt + weight * by_d * by_t, tt + weight * by_t * by_t
                gd, gt = gd + weight * by_d * off, gt + weight * by_t * off
                if square < limit:
                    inliers, squares = inliers + 1, squares + square
        if inliers < 2:
            break
        determinant = (dd + 1e-6) * (tt + 1e-6) - dt * dt
        distance += min(max((tt * gd - dt * gt) / determinant, -MAX_STEP), MAX_STEP)
        turn += min(max((dd * gt - dt * gd) / determinant, -MAX_STEP), MAX_STEP)
        error = squares / inliers
    agree = inliers >= max(MIN_INLIERS, MIN_INLIER_RATIO * (columns >= 0).sum()) and error <= MAX_ERROR
    return np.array((distance, turn)), np.array(((dd, dt), (dt, tt))), agree


@jit
def from_camera(x: float, y: float, distance: float, turn: float, forward: float) -> tuple[float, float]:
    """A point of the body frame as it is ahead and left of the middle of the cameras after an arc."""
    x, y = x - distance * math.cos(turn / 2), y - distance * math.sin(turn / 2)
    return math.cos(turn) * x + math.sin(turn) * y - forward, math.cos(turn) * y - math.sin(turn) * x


@jit
def find_columns(
    before: Cells, rows: Cells, x: Floats, y: Floats, predicted: tuple[float, float], stereo: Stereo
) -> Floats:
    """The present column of every point in either camera, `[n, 2]`; -1 if it is not found."""
    baseline, focal, center, forward = stereo
    columns, cost, size = np.full((len(x), 2), -1.0), np.empty(2 * SEARCH_PX + 1), 2 * PATCH_HALF_PX + 1
    for k in range(len(x)):
        ahead, left = from_camera(x[k], y[k], predicted[0], predicted[1], forward)
        if ahead <= 0:
            continue
        for camera in range(2):
            side = baseline / 2 if camera == 0 else -baseline / 2
            old = center - focal * (y[k] - side) / (x[k] - forward)
            first = math.floor(old + 0.5) - PATCH_HALF_PX
            shifted = math.floor(center - focal * (left - side) / ahead + 0.5)
            start = shifted - SEARCH_PX - PATCH_HALF_PX
            if min(first, start) < 0 or max(first, start + 2 * SEARCH_PX) + size > rows.shape[1]:
                continue
            window = before[camera, first : first + size]
            for r in range(2 * SEARCH_PX + 1):
                patch = rows[camera, start + r : start + r + size]
                cost[r] = np.abs(patch - window - (patch.mean() - window.mean())).mean()
            best = cost.argmin()
            if cost[best] > MAX_DIFFERENCE or best in (0, 2 * SEARCH_PX):
                continue
            if cost[best] > UNIQUENESS_RATIO * cost[np.abs(np.arange(len(cost)) - best) > NEIGHBOURS_PX].min():
                continue
            curve = cost[best - 1] + cost[best + 1] - 2 * cost[best]
            shift = (cost[best - 1] - cost[best + 1]) / (2 * curve) if curve > 1e-9 else 0.0
            columns[k, camera] = old - first + start + best + min(max(shift, -0.5), 0.5)
    return columns
