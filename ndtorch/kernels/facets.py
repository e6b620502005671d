"""Triangles in space as linear functions of a picture's columns and rows.

Olano and Greer, "Triangle scan conversion using 2D homogeneous coordinates" (1997): such functions hold for corners
behind the camera as well, so that nothing has to be clipped.
"""

from __future__ import annotations

import math
from typing import Any

from ndtorch.utils.jit import jit

Array = Any


@jit
def facets(corners: Array, camera: Array, near: float, out: Array, number: Array) -> int:
    """How many triangles turn their face to a camera, with something of them ahead of it.

    Args:
        corners: `[N, 3, 5]` float64: x, y, z, and the place in a picture; counter-clockwise as seen from their face.
        camera: `[4, 3]`: its place, and what a point's offset from it is multiplied with for column times depth,
            row times depth, and depth.
        near: what is nearer is not seen.
        out: `[N, 6, 3]`: factors of column, row and 1 of the three edges (positive inside), of 1 / depth, and of the
            place in the picture over depth.
        number: `[N]`, which triangles these are.
    """
    found = 0
    for n in range(corners.shape[0]):
        x0, y0, w0 = project(corners[n, 0], camera)
        x1, y1, w1 = project(corners[n, 1], camera)
        x2, y2, w2 = project(corners[n, 2], camera)
        if w0 < near and w1 < near and w2 < near:
            continue
        ax, ay, aw = y1 * w2 - w1 * y2, w1 * x2 - x1 * w2, x1 * y2 - y1 * x2
        size = ax * x0 + ay * y0 + aw * w0
        if size > -1e-9:  # rows count downward, which turns the sense of the corners
            continue
        facet, scale = out[found], 1 / size
        facet[0, 0], facet[0, 1], facet[0, 2] = ax * scale, ay * scale, aw * scale
        facet[1, 0], facet[1, 1] = (y2 * w0 - w2 * y0) * scale, (w2 * x0 - x2 * w0) * scale
        facet[1, 2] = (x2 * y0 - y2 * x0) * scale
        facet[2, 0], facet[2, 1] = (y0 * w1 - w0 * y1) * scale, (w0 * x1 - x0 * w1) * scale
        facet[2, 2] = (x0 * y1 - y0 * x1) * scale
        for k in range(3):
            facet[3, k] = facet[0, k] + facet[1, k] + facet[2, k]
            for c in range(2):
                total = facet[0, k] * corners[n, 0, 3 + c] + facet[1, k] * corners[n, 1, 3 + c]
                facet[4 + c, k] = total + facet[2, k] * corners[n, 2, 3 + c]
        number[found] = n
        found += 1
    return found


@jit
def project(corner: Array, camera: Array) -> tuple[float, float, float]:
    """A corner's column and row, both times its depth, and its depth."""
    x, y, z = corner[0] - camera[0, 0], corner[1] - camera[0, 1], corner[2] - camera[0, 2]
    return (
        camera[1, 0] * x + camera[1, 1] * y + camera[1, 2] * z,
        camera[2, 0] * x + camera[2, 1] * y + camera[2, 2] * z,
        camera[3, 0] * x + camera[3, 1] * y + camera[3, 2] * z,
    )


@jit
def bounds(facet: Array, rect: tuple[int, int, int, int], reach: tuple[float, float], rows: Array, ends: Array) -> bool:
    """Whether a triangle may show in a rectangle of the picture (top, bottom, left, right), and where.

    Args:
        reach: nearest and farthest that is drawn.
        rows: the first row, and the one after the last, `[2]`.
        ends: five bounds from the left and five from the right, each a factor of the row and a column: `[2, 5, 2]`.
    """
    (top, bottom, left, right), (near, far) = rect, reach
    first, last = float(top), float(bottom - 1)
    for k in range(5):
        a, b, c = facet[min(k, 3), 0], facet[min(k, 3), 1], facet[min(k, 3), 2]
        if k == 3:
            c -= 1 / far
        elif k == 4:
            a, b, c = -a, -b, 1 / near - c
        ends[0, k, 0] = ends[1, k, 0] = 0.0
        ends[0, k, 1], ends[1, k, 1] = left, right - 1
        if a != 0:
            side = 0 if a > 0 else 1
            ends[side, k, 0], ends[side, k, 1] = -b / a, -c / a
        most = c + max(a * left, a * (right - 1))
        if b > 0:
            first = max(first, -most / b)
        elif b < 0:
            last = min(last, -most / b)
        elif most < 0:
            return False
    if not first <= last:
        return False
    rows[0], rows[1] = math.ceil(first), math.floor(last) + 1
    return True


@jit
def span(ends: Array, row: int) -> tuple[int, int]:
    """The columns of a row that a triangle covers: the first, and the one after the last."""
    low, high = ends[0, 0, 0] * row + ends[0, 0, 1], ends[1, 0, 0] * row + ends[1, 0, 1]
    for k in range(1, 5):
        low = max(low, ends[0, k, 0] * row + ends[0, k, 1])
        high = min(high, ends[1, k, 0] * row + ends[1, k, 1])
    if not low <= high:
        return 0, 0
    return math.ceil(low), math.floor(high) + 1
