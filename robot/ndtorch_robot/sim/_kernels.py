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

i32, u32, f32, u8 = np.int32, np.uint32, np.float32, np.uint8
PAIR, BYTE, HALF, ALL = u32(0xFF00FF), u32(8), u32(0x800080), u32(256)
MIDDLE = f32(128.5)
"""Half a texel of the border, and half a unit to round with, in 256ths of a texel."""
ONE = i32(0x3F800000)
"""The bits of 1.0: a float's bits less these are its binary logarithm, straight from power to power."""


@jit
def mix(a: Any, b: Any, share: Any) -> Any:
    """`a` and `b` mixed, with `share` 256ths of `b`, rounded; two channels each."""
    weighed = u32(u32(a * u32(ALL - share)) + u32(b * share))
    mixed: Any = u32(u32(u32(weighed + HALF) >> BYTE) & PAIR)
    return mixed


@jit
def bilinear(u: float, v: float, texels: Array, start: int, stride: int, wide: float, high: float) -> tuple[Any, Any]:
    """A mipmap's color between four texels: red with blue, and green.

    Args:
        u, v: 0..1 of its width and height.
        texels: `[N]` uint32: red, green, blue from the lowest byte; each mipmap has a border of one texel.
        start, stride: where the mipmap begins, and its texels from row to row.
        wide, high: its size in 256ths of a texel.
    """
    s, t = i32(u * wide + MIDDLE), i32(v * high + MIDDLE)
    x, y = u32(s & 255), u32(t & 255)
    at = i32(i32(start + i32(i32(t >> 8) * stride)) + i32(s >> 8))
    a, b, c, d = texels[at], texels[at + 1], texels[at + stride], texels[at + stride + 1]
    above = mix(u32(a & PAIR), u32(b & PAIR), x)
    below = mix(u32(c & PAIR), u32(d & PAIR), x)
    green_above = mix(u32(u32(a >> BYTE) & PAIR), u32(u32(b >> BYTE) & PAIR), x)
    green_below = mix(u32(u32(c >> BYTE) & PAIR), u32(u32(d >> BYTE) & PAIR), x)
    return mix(above, below, y), mix(green_above, green_below, y)


@jit
def rasterise(
    corners: Array,
    surface: Array,
    texels: Array,
    mipmaps: Array,
    cameras: Array,
    parts: Array,
    reach: tuple[float, float],
    out: Array,
) -> None:
    """Draw parts of frames of textured or plain triangles with trilinear mipmaps, as OpenGL drivers do.

    Args:
        corners: see `visible_triangles`, `[N, 3, 5]`.
        surface: `[N]` int32: number of the texture, or -1 less a color of 24 bits.
        texels: see `bilinear`.
        mipmaps: of each texture, `[P, L, 3]` int32, see `bilinear`; a width of 0 is none.
        cameras: `[C, 4, 3]` float64, see `visible_triangles`.
        parts: `[n, 6]` int64: number of the camera; top, bottom, left and right in its frame; the first pixel in `out`.
            Those of one camera follow each other.
        reach: nearest and farthest that is drawn, m.
        out: `[pixels, 3]` uint8; rows of a part follow each other.
    """
    widest, many = (parts[:, 4] - parts[:, 3]).max(), corners.shape[0]
    triangle, number, some = np.empty((many, 6, 3)), np.empty(many, np.int64), np.empty(many, np.int64)
    rows, ends = np.empty((many, 2), np.int64), np.empty((many, 2, 5, 2))
    nearest, which, line = np.empty(widest, np.float32), np.empty(widest, np.int32), np.empty(widest, np.uint32)
    u, v, square = np.empty(widest, np.float32), np.empty(widest, np.float32), np.empty(widest, np.float32)
    ramp, sizes = np.arange(widest).astype(np.float32), np.empty(widest, np.int32)
    bits, aimed, count = square.view(np.int32), np.int64(-1), 0
    for k in range(parts.shape[0]):
        camera, top, bottom, left, right, start = parts[k]
        if camera != aimed:
            count, aimed = visible_triangles(corners, cameras[camera], reach[0], triangle, number), camera
        few, width = 0, right - left
        for n in range(count):
            if bounds(triangle[n], (top, bottom, left, right), reach, rows[few], ends[few]):
                some[few] = n
                few += 1
        for row in range(top, bottom):
            depth_test(triangle, some[:few], rows, ends, row, left, ramp, nearest[:width], which[:width])
            x = 0
            while x < width:
                end, n = x + 1, which[x]
                while end < width and which[end] == n:
                    end += 1
                if n < 0 or surface[number[n]] < 0:
                    line[x:end] = 0 if n < 0 else -1 - surface[number[n]]
                else:
                    mipmap = mipmaps[surface[number[n]]]
                    texture_coordinates(triangle[n], row, left + x, mipmap[0], ramp, u[x:end], v[x:end], square[x:end])
                    shade(u[x:end], v[x:end], bits[x:end], sizes[x:end], texels, mipmap, line[x:end])
                x = end
            for x in range(width):
                pixel = out[start + x]
                pixel[0], pixel[1], pixel[2] = u8(line[x]), u8(line[x] >> 8), u8(line[x] >> 16)
            start += width


@jit
def depth_test(
    triangle: Array,
    some: Array,
    rows: Array,
    ends: Array,
    row: int,
    left: int,
    ramp: Array,
    nearest: Array,
    which: Array,
) -> None:
    """The nearest triangle at every column of a row, -1 where there is none."""
    nearest[:] = 0
    which[:] = -1
    for k in range(some.shape[0]):
        if rows[k, 0] <= row < rows[k, 1]:
            n, (first, end) = i32(some[k]), span(ends[k], row)
            slope = f32(triangle[n, 3, 0])
            begin = f32(triangle[n, 3, 0] * first + triangle[n, 3, 1] * row + triangle[n, 3, 2])
            if first < end:
                update_depth(slope, begin, n, ramp, nearest[first - left : end - left], which[first - left :])


@jit
def update_depth(slope: float, begin: float, n: int, ramp: Array, nearest: Array, which: Array) -> None:
    """Enter this triangle where it is nearer than all so far."""
    for x in range(nearest.shape[0]):
        depth = slope * ramp[x] + begin
        which[x] = n if depth > nearest[x] else which[x]
        nearest[x] = max(depth, nearest[x])


@jit
def texture_coordinates(
    triangle: Array, row: int, left: int, mipmap: Array, ramp: Array, u: Array, v: Array, square: Array
) -> None:
    """Texture coordinates along some columns of a row, and how many texels a pixel spans, squared."""
    wide, high = f32(mipmap[1]), f32(mipmap[2])
    depth, across, up = triangle[3], triangle[4], triangle[5]
    q, s = depth[0] * left + depth[1] * row + depth[2], across[0] * left + across[1] * row + across[2]
    t = up[0] * left + up[1] * row + up[2]
    # Whole repetitions of the texture are subtracted before numbers are rounded to 24 bits.
    turn, turn_up = np.floor(s / q), np.floor(t / q)
    q0, s0, t0 = f32(q), f32(s - turn * q), f32(t - turn_up * q)
    qx, sx, tx = f32(depth[0]), f32(across[0] - turn * depth[0]), f32(up[0] - turn_up * depth[0])
    qy, sy, ty = f32(depth[1]), f32(across[1] - turn * depth[1]), f32(up[1] - turn_up * depth[1])
    for k in range(u.shape[0]):
        x = ramp[k]
        far = f32(1) / (qx * x + q0)
        a, b = (sx * x + s0) * far, (tx * x + t0) * far
        u[k], v[k] = a - np.floor(a), b - np.floor(b)
        along_u, along_v = (sx - a * qx) * wide, (tx - b * qx) * high
        down_u, down_v = (sy - a * qy) * wide, (ty - b * qy) * high
        square[k] = max(along_u * along_u + along_v * along_v, down_u * down_u + down_v * down_v) * far * far


@jit
def sample_bilinear(u: Array, v: Array, texels: Array, mipmap: Array, line: Array) -> None:
    """Colors `[n]` of one mipmap. `mipmap`: where it begins, its width and its height in texels, `[3]` int32."""
    start, stride = mipmap[0], i32(mipmap[1] + 2)
    wide, high = f32(mipmap[1] * 256), f32(mipmap[2] * 256)
    for k in range(line.shape[0]):
        both, green = bilinear(u[k], v[k], texels, start, stride, wide, high)
        line[k] = u32(both | u32(green << BYTE))


@jit
def sample_trilinear(u: Array, v: Array, shares: Array, texels: Array, mipmaps: Array, line: Array) -> None:
    """Colors `[n]` between two mipmaps.

    Args:
        shares: weight of the second mipmap, 256ths in the lowest eight bits, `[n]` int32.
        mipmaps: two, each as `mipmap` of `sample_bilinear`, `[2, 3]`.
    """
    start, stride = mipmaps[0, 0], i32(mipmaps[0, 1] + 2)
    wide, high = f32(mipmaps[0, 1] * 256), f32(mipmaps[0, 2] * 256)
    next_start, next_stride = mipmaps[1, 0], i32(mipmaps[1, 1] + 2)
    next_wide, next_high = f32(mipmaps[1, 1] * 256), f32(mipmaps[1, 2] * 256)
    for k in range(line.shape[0]):
        both, green = bilinear(u[k], v[k], texels, start, stride, wide, high)
        small, small_green = bilinear(u[k], v[k], texels, next_start, next_stride, next_wide, next_high)
        share = u32(shares[k] & 255)
        line[k] = u32(mix(both, small, share) | u32(mix(green, small_green, share) << BYTE))


@jit
def shade(u: Array, v: Array, bits: Array, sizes: Array, texels: Array, mipmaps: Array, line: Array) -> None:
    """Colors of some columns, from the mipmaps whose texels are about as large as a pixel.

    Args:
        bits: of the squares that `texture_coordinates` found, as int32.
        sizes: becomes twice the logarithm of those, in 256ths.
    """
    last = 0
    while last + 1 < mipmaps.shape[0] and mipmaps[last + 1, 1] > 0:
        last += 1
    least, most = mipmap_levels(bits, i32(last << 8), sizes)
    if most == 0:
        sample_bilinear(u, v, texels, mipmaps[0], line)
        return
    first, end = 0, line.shape[0]
    while first < end:
        level, until = sizes[first] >> 8, end
        if least >> 8 != most >> 8:
            until = first + 1
            while until < end and sizes[until] >> 8 == level:
                until += 1
        pair = mipmaps[min(level, last - 1) :]
        if level == last:
            sample_bilinear(u[first:until], v[first:until], texels, mipmaps[last], line[first:until])
        else:
            sample_trilinear(u[first:until], v[first:until], sizes[first:until], texels, pair, line[first:until])
        first = until


@jit
def mipmap_levels(bits: Array, most: Any, sizes: Array) -> tuple[Any, Any]:
    """Levels in 256ths, from 0 to `most`; the smallest and the largest of them."""
    low: Any = most
    high: Any = i32(0)
    for k in range(sizes.shape[0]):
        size = min(max(i32(i32(bits[k] - ONE) >> i32(16)), i32(0)), most)
        sizes[k] = size
        low, high = min(low, size), max(high, size)
    return low, high


@jit
def visible_triangles(corners: Array, camera: Array, near: float, out: Array, number: Array) -> int:
    """Project the triangles that face a camera and lie at least partly ahead of it; returns their number.

    Args:
        corners: `[N, 3, 5]` float64: x, y, z and texture coordinates; counter-clockwise as seen from the front.
        camera: `[4, 3]`: its position, and the factors of a point's offset from it that give column times depth,
            row times depth, and depth.
        near: smallest depth that is drawn.
        out: `[N, 6, 3]`: factors of column, row and 1 of the three edges (positive inside), of 1 / depth, and of the
            texture coordinates over depth.
        number: `[N]`, their numbers.
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
        triangle, scale = out[found], 1 / size
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
def bounds(
    triangle: Array, rect: tuple[int, int, int, int], reach: tuple[float, float], rows: Array, ends: Array
) -> bool:
    """Whether a triangle may be visible in a rectangle of the frame (top, bottom, left, right), and where.

    Args:
        reach: nearest and farthest that is drawn.
        rows: the first row, and the one after the last, `[2]`.
        ends: five bounds from the left and five from the right, each a factor of the row and a column: `[2, 5, 2]`.
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
    """Whether a rectangle touches segments `[S, 2, 2]` or circles `[C, 3]` (x, y, radius), by separating axes.

    Args:
        x, y, heading: pose of its middle, m and radians.
        half: half its length and width, m, `[2]`.
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
