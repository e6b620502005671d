"""Normal distributions transform: a map of Gaussian cells, and matching of a scan with it.

P. Biber and W. Straßer, "The normal distributions transform: a new approach to laser scan matching", IROS 2003. A cell
holds the weight of its points and the sums of x, y, xx, xy and yy about its middle, from which mean and covariance
follow. A map is an array of cells `[size, size, 6]`, float32, whose middle is the origin of its frame.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float64]
Cells = npt.NDArray[np.float32]

MIN_WEIGHT = 1.5  # cells of less weight do not take part in matching

MAX_WEIGHT = 1e5
"""The sums of a heavier cell are scaled down to this weight, so that it stays able to change."""

BLUR_M = 0.02  # standard deviation added to the distribution of each cell

OUTLIER_GATE = 9.0
"""Squared Mahalanobis distance at which a point has a quarter of its weight; at four times it has none."""

ITERATIONS = 8  # Gauss-Newton iterations of a scan match, at most
MAX_STEP = 0.1  # Gauss-Newton steps are no larger than this, m and radians


class Scan(NamedTuple):
    """Points in the body frame, m, and their weights, `[n]` each."""

    x: Floats
    y: Floats
    weight: Floats


class ScanMatch(NamedTuple):
    """A matched pose x, y, m, and heading, radians, `[3]`, its score, 0..1, and its information matrix `[3, 3]` as if
    all points were independent."""

    pose: Floats
    score: float
    information: Floats


def empty_map(size: int) -> Cells:
    return np.zeros((size, size, 6), np.float32)


@jit
def add_scan(ndt_map: Cells, scan: Scan, pose: Floats, cell_m: float) -> Cells:
    """A copy of the map to which a scan taken at a pose is added; points outside are left out."""
    half, cos, sin, ndt_map = ndt_map.shape[0] // 2, math.cos(pose[2]), math.sin(pose[2]), ndt_map.copy()
    for k in range(len(scan.x)):
        x, y = pose[0] + cos * scan.x[k] - sin * scan.y[k], pose[1] + sin * scan.x[k] + cos * scan.y[k]
        i, j = math.floor(x / cell_m), math.floor(y / cell_m)
        if not (-half <= i < half and -half <= j < half):
            continue
        cell, w = ndt_map[i + half, j + half], scan.weight[k]
        dx, dy = x - (i + 0.5) * cell_m, y - (j + 0.5) * cell_m
        cell[0] += w
        cell[1] += w * dx
        cell[2] += w * dy
        cell[3] += w * dx * dx
        cell[4] += w * dx * dy
        cell[5] += w * dy * dy
        if cell[0] > MAX_WEIGHT:
            cell *= np.float32(MAX_WEIGHT / cell[0])
    return ndt_map


@jit
def match_scan(ndt_map: Cells, scan: Scan, start: Floats, sigma: tuple[float, float], cell_m: float) -> ScanMatch:
    """The pose at which a scan fits the map.

    Gauss-Newton on the squared Mahalanobis distances d^2 of the points from the nearest of the nine cells around them,
    weighted by 1 / (1 + d^2 / OUTLIER_GATE)^2, and on the distance from `start`.

    Args:
        start: predicted pose, `[3]`.
        sigma: standard deviations of its position, m, and of its heading, radians.
    """
    half, pose, score = ndt_map.shape[0] // 2, start.copy(), 0.0
    precision = np.array((sigma[0], sigma[0], sigma[1])) ** -2.0
    prior = np.diag(precision)
    h = np.zeros((3, 3))
    for _ in range(ITERATIONS):
        h[:] = 0.0
        rhs = precision * (start - pose)
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        score = 0.0
        for k in range(len(scan.x)):
            rx, ry = cos * scan.x[k] - sin * scan.y[k], sin * scan.x[k] + cos * scan.y[k]
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
            score += scan.weight[k] * math.exp(-best / 2)
            w = scan.weight[k] / (1 + best / OUTLIER_GATE) ** 2
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
    return ScanMatch(pose, score / max(scan.weight.sum(), 1e-9), h)


def to_sparse(ndt_map: Cells) -> Cells:
    """The cells that hold points, `[k, 8]`: column and row counted from the middle, and six sums."""
    at = np.argwhere(ndt_map[..., 0])
    return np.concatenate(((at - ndt_map.shape[0] // 2).astype(np.float32), ndt_map[at[:, 0], at[:, 1]]), -1)


def from_sparse(sparse: npt.NDArray[np.floating], size: int) -> Cells:
    """The inverse of `to_sparse`; cells outside the square are dropped."""
    ndt_map, half = empty_map(size), size // 2
    at = np.rint(sparse[:, :2]).astype(np.int64)
    inside = ((at >= -half) & (at < half)).all(-1)
    column, row = (at[inside] + half).T
    ndt_map[column, row] = sparse[inside, 2:]
    return ndt_map
