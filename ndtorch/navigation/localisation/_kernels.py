"""Kernels of localisation: NDT cells and matching, and visual odometry of rows."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float64]
Cells = npt.NDArray[np.float32]

MIN_WEIGHT = 1.5
"""Cells of less weight do not take part in matching."""

MAX_WEIGHT = 1e5
"""The sums of a heavier cell are scaled down to this weight, so that it stays able to change."""

BLUR_M = 0.02
"""Standard deviation added to the distribution of each cell."""

OUTLIER_GATE = 9.0
"""Squared Mahalanobis distance at which a point has a quarter of its weight; at four times it has none."""

ITERATIONS = 8
"""Gauss-Newton iterations of a scan match, at most."""

MAX_STEP = 0.1
"""Gauss-Newton steps are no larger than this, m and radians."""


@jit
def add_points(ndt_map: Cells, x: Floats, y: Floats, weight: Floats, cell_m: float) -> None:
    """Add points `[n]` to a map in place; points outside are left out."""
    half = ndt_map.shape[0] // 2
    for k in range(len(x)):
        i, j = math.floor(x[k] / cell_m), math.floor(y[k] / cell_m)
        if not (-half <= i < half and -half <= j < half):
            continue
        cell = ndt_map[i + half, j + half]
        dx, dy, w = x[k] - (i + 0.5) * cell_m, y[k] - (j + 0.5) * cell_m, weight[k]
        cell[0] += w
        cell[1] += w * dx
        cell[2] += w * dy
        cell[3] += w * dx * dx
        cell[4] += w * dx * dy
        cell[5] += w * dy * dy
        if cell[0] > MAX_WEIGHT:
            keep = MAX_WEIGHT / cell[0]
            for n in range(6):
                cell[n] *= keep


@jit
def ndt_match(
    ndt_map: Cells, x: Floats, y: Floats, weight: Floats, start: Floats, precision: Floats, cell_m: float
) -> tuple[Floats, float, Floats]:
    """Pose `[3]` at which points fit a map, score 0..1, and information `[3, 3]` of the points.

    Gauss-Newton on the squared Mahalanobis distances d^2 of the points from the nearest of the nine cells around them,
    weighted by 1 / (1 + d^2 / OUTLIER_GATE)^2, and on the distance from `start`.

    Args:
        x, y, weight: points in the body frame, `[n]`.
        start: predicted pose, `[3]`.
        precision: one over the variances of its x, y and heading, `[3]`.
    """
    half, pose, score = ndt_map.shape[0] // 2, start.copy(), 0.0
    prior = np.diag(precision)
    h = np.zeros((3, 3))
    for _ in range(ITERATIONS):
        h[:] = 0.0
        rhs = precision * (start - pose)
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        score = 0.0
        for k in range(len(x)):
            rx, ry = cos * x[k] - sin * y[k], sin * x[k] + cos * y[k]
            wx, wy = pose[0] + rx, pose[1] + ry
            i, j = math.floor(wx / cell_m), math.floor(wy / cell_m)
            if not (1 - half <= i < half - 1 and 1 - half <= j < half - 1):
                continue
            best, vx, vy, xx, xy, yy = 1e9, 0.0, 0.0, 0.0, 0.0, 0.0
            for ii in range(i - 1, i + 2):
                for jj in range(j - 1, j + 2):
                    at = ndt_map[ii + half, jj + half]
                    if at[0] < MIN_WEIGHT:
                        continue
                    mx, my = at[1] / at[0], at[2] / at[0]
                    sxx = at[3] / at[0] - mx * mx + BLUR_M * BLUR_M
                    syy = at[5] / at[0] - my * my + BLUR_M * BLUR_M
                    sxy = at[4] / at[0] - mx * my
                    ex, ey = wx - (ii + 0.5) * cell_m - mx, wy - (jj + 0.5) * cell_m - my
                    determinant = sxx * syy - sxy * sxy
                    d = (syy * ex * ex - 2 * sxy * ex * ey + sxx * ey * ey) / determinant
                    if d < best:
                        best = d
                        xx, xy, yy = syy / determinant, -sxy / determinant, sxx / determinant
                        vx, vy = xx * ex + xy * ey, xy * ex + yy * ey
            if best > 4 * OUTLIER_GATE:
                continue
            score += weight[k] * math.exp(-best / 2)
            w = weight[k] / (1 + best / OUTLIER_GATE) ** 2
            rhs[0] -= w * vx
            rhs[1] -= w * vy
            rhs[2] -= w * (rx * vy - ry * vx)
            h[0, 0] += w * xx
            h[0, 1] += w * xy
            h[1, 1] += w * yy
            h[0, 2] += w * (rx * xy - ry * xx)
            h[1, 2] += w * (rx * yy - ry * xy)
            h[2, 2] += w * (ry * ry * xx - 2 * rx * ry * xy + rx * rx * yy)
        h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
        step = np.linalg.solve(h + prior, rhs)
        pose += np.minimum(np.maximum(step, -MAX_STEP), MAX_STEP)
        if np.abs(step).sum() < 1e-4:
            break
    return pose, score / max(weight.sum(), 1e-9), h


PATCH_HALF_PX = 8
"""Pixels compared to either side of a point."""

SEARCH_PX = 24
"""Points are searched for within this distance of their predicted column."""

MAX_DIFFERENCE = 0.05
"""Mean absolute difference of a match, for intensities 0..1, at most."""

UNIQUENESS_RATIO, NEIGHBOURS_PX = 0.8, 2
"""A match must differ by less than this ratio of the best one farther away than the neighbours."""

COLUMN_SIGMA_PX, DISPARITY_SIGMA_PX = 0.39, 0.3
"""Standard deviations of the column and of the disparity of a point."""

MOTION_GATE = 6.0
"""Squared error, in standard deviations, at which a point has a quarter of its weight."""

MOTION_ITERATIONS, GATE_FACTORS = 6, (400.0, 60.0, 9.0)
"""Gauss-Newton iterations, and factors of the gate in the first ones: the prediction may be some pixels off."""


class Stereo(NamedTuple):
    """Baseline, m, focal length and middle column, pixels, and place of the cameras ahead of the body's origin, m."""

    baseline: float
    focal: float
    center: float
    forward: float


class RowMotion(NamedTuple):
    """Distance, m, and turn, radians, their information dd, dt, tt, the number of inliers, the mean of their squared
    errors in standard deviations, and the number of matched columns."""

    distance: float
    turn: float
    dd: float
    dt: float
    tt: float
    inliers: int
    error: float
    matches: int


@jit
def row_visual_odometry(
    before: Cells, rows: Cells, x: Floats, y: Floats, predicted: tuple[float, float], stereo: Stereo
) -> RowMotion:
    """Distance along an arc and turn between two row pairs `[2, W]`, left first.

    The surroundings of every point in the first rows are searched for in the second ones. Gauss-Newton finds the motion
    that explains the columns found, weighted by 1 / (1 + e^2 / gate)^2 for an error of e standard deviations.

    Args:
        x, y: points in the body frame of the first rows, m, `[n]`.
        predicted: distance and turn, m and radians.
    """
    columns = find_columns(before, rows, x, y, predicted, stereo)
    distance, turn = predicted
    dd = dt = tt = error = 0.0
    inliers = 0
    for step in range(MOTION_ITERATIONS):
        dd = dt = tt = gd = gt = squares = 0.0
        inliers = 0
        cos, sin = math.cos(turn / 2), math.sin(turn / 2)
        limit = MOTION_GATE * (GATE_FACTORS[step] if step < len(GATE_FACTORS) else 1.0)
        for k in range(len(x)):
            ahead, left = from_camera(x[k], y[k], distance, turn, stereo.forward)
            if ahead <= 0:
                continue
            ahead_t, left_t = left - distance * sin / 2, -ahead - stereo.forward - distance * cos / 2
            for camera in range(2):
                if columns[k, camera] < 0:
                    continue
                side = stereo.baseline / 2 if camera == 0 else -stereo.baseline / 2
                old, new = (y[k] - side) / (x[k] - stereo.forward), (left - side) / ahead
                # The shift that the turn does not explain comes from the distance, and is as uncertain as the range.
                by_distance = abs(stereo.focal * (old - new) - stereo.focal * turn * (1 + old * old))
                ratio = by_distance * (x[k] - stereo.forward) / (stereo.focal * stereo.baseline)
                variance = COLUMN_SIGMA_PX**2 + (DISPARITY_SIGMA_PX * ratio) ** 2
                by_d = -stereo.focal * (sin + new * cos) / ahead
                by_t = -stereo.focal * (left_t - new * ahead_t) / ahead
                off = columns[k, camera] - (stereo.center - stereo.focal * new)
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
    return RowMotion(distance, turn, dd, dt, tt, inliers, error, (columns >= 0).sum())


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
    columns, cost, size = np.full((len(x), 2), -1.0), np.empty(2 * SEARCH_PX + 1), 2 * PATCH_HALF_PX + 1
    for k in range(len(x)):
        ahead, left = from_camera(x[k], y[k], predicted[0], predicted[1], stereo.forward)
        if ahead <= 0:
            continue
        for camera in range(2):
            side = stereo.baseline / 2 if camera == 0 else -stereo.baseline / 2
            old = stereo.center - stereo.focal * (y[k] - side) / (x[k] - stereo.forward)
            first = math.floor(old + 0.5) - PATCH_HALF_PX
            shifted = math.floor(stereo.center - stereo.focal * (left - side) / ahead + 0.5)
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
