"""The pose from which points fit what was summed up in cells."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[Any]


@jit
def fit_points(
    sums: Floats,
    x: Floats,
    y: Floats,
    weight: Floats,
    start: tuple[float, float, float],
    trust: tuple[float, float, float],
    cell: float,
    blur: float,
    least: float,
    gate: float,
    steps: int,
    out: Floats,
) -> None:
    """Fill `out` `[10]`: a pose x, y, heading, how well the points fit there, 0..1, and how much they say of the pose.

    Gauss-Newton on the squared Mahalanobis distances of the points from the normal distributions of the cells
    around them, of each the nearest, weighted by 1 / (1 + d^2 / gate)^2, and on the distance from `start`. What they
    say is the information matrix of the last step without that of `start`: xx, xy, yy, xh, yh, hh.

    Args:
        sums: `[size, size, 6]` of `add_points`.
        x, y, weight: points of the body frame, `[n]`.
        start: the pose expected.
        trust: one over the variances of its x, y and heading.
        cell: side of a cell, m.
        blur: standard deviation that is added to every distribution, m.
        least: weight that a cell must have.
        gate: squared distance at which a point counts a quarter; at four times it counts nothing.
        steps: at most.
    """
    size = sums.shape[0]
    half = size // 2
    px, py, heading = start
    a, b, h, rhs = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    score = total = 0.0
    for _ in range(steps):
        a[0], a[1], a[2] = px - start[0], py - start[1], heading - start[2]
        h[:] = 0.0
        for n in range(3):
            h[n, n] = trust[n]
            rhs[n] = -trust[n] * a[n]
        cos, sin = math.cos(heading), math.sin(heading)
        score = total = 0.0
        for k in range(len(x)):
            rx, ry = cos * x[k] - sin * y[k], sin * x[k] + cos * y[k]
            wx, wy = px + rx, py + ry
            i, j = math.floor(wx / cell), math.floor(wy / cell)
            total += weight[k]
            if not (1 - half <= i < half - 1 and 1 - half <= j < half - 1):
                continue
            best, vx, vy, xx, xy, yy = 1e9, 0.0, 0.0, 0.0, 0.0, 0.0
            for ii in range(i - 1, i + 2):
                for jj in range(j - 1, j + 2):
                    at = sums[ii + half, jj + half]
                    if at[0] < least:
                        continue
                    mx, my = at[1] / at[0], at[2] / at[0]
                    sxx = at[3] / at[0] - mx * mx + blur * blur
                    syy = at[5] / at[0] - my * my + blur * blur
                    sxy = at[4] / at[0] - mx * my
                    ex, ey = wx - (ii + 0.5) * cell - mx, wy - (jj + 0.5) * cell - my
                    size_ = sxx * syy - sxy * sxy
                    d = (syy * ex * ex - 2 * sxy * ex * ey + sxx * ey * ey) / size_
                    if d < best:
                        best = d
                        xx, xy, yy = syy / size_, -sxy / size_, sxx / size_
                        vx, vy = xx * ex + xy * ey, xy * ex + yy * ey
            if best > 4 * gate:
                continue
            score += weight[k] * math.exp(-best / 2)
            w = weight[k] / (1 + best / gate) ** 2
            rhs[0] -= w * vx
            rhs[1] -= w * vy
            rhs[2] -= w * (rx * vy - ry * vx)
            h[0, 0] += w * xx
            h[0, 1] += w * xy
            h[1, 1] += w * yy
            h[0, 2] += w * (rx * xy - ry * xx)
            h[1, 2] += w * (rx * yy - ry * xy)
            h[2, 2] += w * (ry * ry * xx - 2 * rx * ry * xy + rx * rx * yy)
        out[4], out[5], out[6] = h[0, 0] - trust[0], h[0, 1], h[1, 1] - trust[1]
        out[7], out[8], out[9] = h[0, 2], h[1, 2], h[2, 2] - trust[2]
        # Cholesky of three rows: h = b b^T.
        b[0, 0] = math.sqrt(h[0, 0])
        b[1, 0], b[2, 0] = h[0, 1] / b[0, 0], h[0, 2] / b[0, 0]
        b[1, 1] = math.sqrt(h[1, 1] - b[1, 0] ** 2)
        b[2, 1] = (h[1, 2] - b[2, 0] * b[1, 0]) / b[1, 1]
        b[2, 2] = math.sqrt(h[2, 2] - b[2, 0] ** 2 - b[2, 1] ** 2)
        u = rhs[0] / b[0, 0]
        v = (rhs[1] - b[1, 0] * u) / b[1, 1]
        c = (rhs[2] - b[2, 0] * u - b[2, 1] * v) / b[2, 2] / b[2, 2]
        v = (v - b[2, 1] * c) / b[1, 1]
        u = (u - b[1, 0] * v - b[2, 0] * c) / b[0, 0]
        px += min(max(u, -0.1), 0.1)
        py += min(max(v, -0.1), 0.1)
        heading += min(max(c, -0.1), 0.1)
        if abs(u) + abs(v) + abs(c) < 1e-4:
            break
    out[0], out[1], out[2], out[3] = px, py, heading, score / max(total, 1e-9)
