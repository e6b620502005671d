"""Rasteriser for textured triangles, row by row: the depth test for each pixel first, then colors where they show.

Triangles are linear functions of columns and rows: Olano and Greer, "Triangle scan conversion using 2D homogeneous
coordinates" (1997). Such functions hold for corners behind the camera as well, so that nothing has to be clipped.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ndtorch.utils.jit import jit

Array = Any


@jit
def rasterise(
    corners: Array, surface: Array, texels: Array, mipmaps: Array, views: Array, parts: Array, reach: Array, out: Array
) -> None:
    """Draw parts of frames of textured or plain triangles with trilinear mipmaps, as far as `reach`, m, goes.

    Args:
        corners, views: see `visible_triangles`, `[N, 3, 5]` and `[C, 4, 3]`.
        surface: `[N]` int32: number of the texture, or -1 less a color of 24 bits.
        texels: `[T]` uint32: red, green, blue from the lowest byte; each mipmap has a border of one texel.
        mipmaps: of each texture, `[P, L, 3]` int32: where it begins, its width and its height in texels.
        parts: `[n, 6]` int64: number of the camera; top, bottom, left and right in its frame; the first pixel in `out`
            `[pixels, 3]`. Those of one camera follow each other.
    """
    widest, many = (parts[:, 4] - parts[:, 3]).max(), corners.shape[0]
    triangle, number, some = np.empty((many, 6, 3)), np.empty(many, np.int64), np.empty(many, np.int64)
    rows, ends, color = np.empty((many, 2), np.int64), np.empty((many, 2, 5, 2)), np.empty(3)
    nearest, which, aimed, count = np.empty(widest), np.empty(widest, np.int64), np.int64(-1), 0
    for k in range(parts.shape[0]):
        camera, top, bottom, left, right, start = parts[k]
        if camera != aimed:
            count, aimed = visible_triangles(corners, views[camera], reach[0], triangle, number), camera
        few = 0
        for n in range(count):
            if bounds(triangle[n], (top, bottom, left, right), reach, rows[few], ends[few]):
                some[few] = n
                few += 1
        for row in range(top, bottom):
            nearest[:] = 0
            which[:] = -1
            for i in range(few):
                if rows[i, 0] <= row < rows[i, 1]:
                    first, end = span(ends[i], row)
                    slope, base = triangle[some[i], 3, 0], triangle[some[i], 3, 1] * row + triangle[some[i], 3, 2]
                    for x in range(first, end):
                        if slope * x + base > nearest[x - left]:
                            nearest[x - left], which[x - left] = slope * x + base, some[i]
            for x in range(left, right):
                n, pixel = which[x - left], out[start + x - left]
                plain = 0 if n < 0 else -1 - surface[number[n]]
                if n >= 0 and plain < 0:
                    shade(triangle[n], x, row, texels, mipmaps[surface[number[n]]], color)
                for c in range(3):
                    pixel[c] = np.uint8(color[c]) if n >= 0 and plain < 0 else np.uint8(plain >> 8 * c & 255)
            start += right - left


@jit
def shade(triangle: Array, column: int, row: int, texels: Array, mipmaps: Array, color: Array) -> None:
    """The color `[3]` of a pixel, between the two mipmaps whose texels are about as large, and a half."""
    depth, across, up = triangle[3], triangle[4], triangle[5]
    far = 1 / (depth[0] * column + depth[1] * row + depth[2])
    u = (across[0] * column + across[1] * row + across[2]) * far
    v = (up[0] * column + up[1] * row + up[2]) * far
    square = 1.0
    for k in range(2):
        along = (across[k] - u * depth[k]) * far * mipmaps[0, 1]
        down = (up[k] - v * depth[k]) * far * mipmaps[0, 2]
        square = max(square, along * along + down * down)
    level = min(0.5 * math.log2(square), mipmaps.shape[0] - 1.001)
    first = int(level)
    color[:] = 0.5
    add_bilinear(u - math.floor(u), v - math.floor(v), texels, mipmaps[first], first + 1 - level, color)
    if level > first:
        add_bilinear(u - math.floor(u), v - math.floor(v), texels, mipmaps[first + 1], level - first, color)


@jit
def add_bilinear(u: float, v: float, texels: Array, mipmap: Array, weight: float, color: Array) -> None:
    """Add the color of a mipmap between four texels, at 0..1 of its width and height."""
    s, t, stride = u * mipmap[1] + 0.5, v * mipmap[2] + 0.5, mipmap[1] + 2
    x, y = int(s), int(t)
    for k in range(4):
        texel = np.int64(texels[mipmap[0] + (y + (k >> 1)) * stride + x + (k & 1)])
        part = weight * (s - x if k & 1 else 1 + x - s) * (t - y if k >> 1 else 1 + y - t)
        for c in range(3):
            color[c] += part * (texel >> 8 * c & 255)


@jit
def visible_triangles(corners: Array, camera: Array, near: float, out: Array, number: Array) -> int:
    """Project the triangles that face a camera and lie partly ahead of `near`; returns how many.

    `corners` `[N, 3, 5]` are x, y, z and texture coordinates, counter-clockwise from the front. `camera` `[4, 3]` is
    its position, and the factors of an offset from it that give column times depth, row times depth, and depth. `out`
    `[N, 6, 3]` are factors of column, row and 1 of the three edges (positive inside), of 1 / depth, and of the texture
    coordinates over depth.
    """
    visible = 0
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
        triangle, scale = out[visible], 1 / size
        triangle[0, 0], triangle[0, 1], triangle[0, 2] = ax * scale, ay * scale, aw * scale
        triangle[1, 0], triangle[1, 1] = (y2 * w0 - w2 * y0) * scale, (w2 * x0 - x2 * w0) * scale
        triangle[1, 2] = (x2 * y0 - y2 * x0) * scale
        triangle[2, 0], triangle[2, 1] = (y0 * w1 - w0 * y1) * scale, (w0 * x1 - x0 * w1) * scale
        triangle[2, 2] = (x0 * y1 - y0 * x1) * scale
        for k in range(3):
            triangle[3, k] = triangle[0, k] + triangle[1, k] + triangle[2, k]
            for c in range(2):
                total = triangle[0, k] * corners[n, 0, 3 + c] + triangle[1, k] * corners[n, 1, 3 + c]
                triangle[4 + c, k] = total + triangle[2, k] * corners[n, 2, 3 + c]
        number[visible] = n
        visible += 1
    return visible


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
def bounds(
    triangle: Array, rect: tuple[int, int, int, int], reach: tuple[float, float], rows: Array, ends: Array
) -> bool:
    """Whether a triangle may be visible in a rectangle of the frame (top, bottom, left, right), and where.

    `rows` are the first one and the one after the last, and `ends` `[2, 5, 2]` five bounds from the left and five from
    the right, each a factor of the row and a column.
    """
    (top, bottom, left, right), (near, far) = rect, reach
    first, last = float(top), float(bottom - 1)
    for k in range(5):
        a, b, c = triangle[min(k, 3), 0], triangle[min(k, 3), 1], triangle[min(k, 3), 2]
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


@jit
def rectangle_touches(x: float, y: float, heading: float, half: Array, segments: Array, circles: Array) -> bool:
    """Whether a rectangle with these half sides `[2]` about a pose, m and radians, touches segments `[S, 2, 2]` or
    circles `[C, 3]` (x, y, radius), by separating axes.
    """
    cos, sin, long, wide = math.cos(heading), math.sin(heading), half[0], half[1]
    for k in range(segments.shape[0]):
        dx, dy = (segments[k, 0, 0] + segments[k, 1, 0]) / 2 - x, (segments[k, 0, 1] + segments[k, 1, 1]) / 2 - y
        ex, ey = (segments[k, 1, 0] - segments[k, 0, 0]) / 2, (segments[k, 1, 1] - segments[k, 0, 1]) / 2
        ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
        along, across = cos * ex + sin * ey, cos * ey - sin * ex
        apart = abs(ahead) > long + abs(along) or abs(aside) > wide + abs(across)
        if not apart and abs(ahead * across - aside * along) <= long * abs(across) + wide * abs(along):
            return True
    for k in range(circles.shape[0]):
        dx, dy = circles[k, 0] - x, circles[k, 1] - y
        ahead, aside = abs(cos * dx + sin * dy) - long, abs(cos * dy - sin * dx) - wide
        if math.hypot(max(ahead, 0.0), max(aside, 0.0)) < circles[k, 2]:
            return True
    return False
