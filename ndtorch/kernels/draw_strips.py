"""Pictures of textured triangles, row by row: for each pixel the nearest triangle first, then colors where it shows."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch.kernels.facets import bounds, facets, span
from ndtorch.kernels.texture_sample import one_copy, two_copies
from ndtorch.utils.jit import jit

Array = Any

i32, f32, u8 = np.int32, np.float32, np.uint8
ONE = i32(0x3F800000)
"""The bits of 1.0: a float's bits less these are its binary logarithm, straight from power to power."""


@jit
def draw_strips(
    corners: Array,
    surface: Array,
    texels: Array,
    copies: Array,
    cameras: Array,
    parts: Array,
    reach: tuple[float, float],
    out: Array,
) -> None:
    """Parts of pictures of textured or plain triangles, as a driver of OpenGL draws them with mixed small copies.

    Args:
        corners: see `facets`, `[N, 3, 5]`.
        surface: `[N]` int32: the picture on it, or -1 less its color, 24 bits.
        texels: see `level`.
        copies: of each picture, `[P, L, 3]` int32, see `one_copy`; none where the width is 0.
        cameras: `[C, 4, 3]` float64, see `facets`.
        parts: `[n, 6]` int64: which camera; top, bottom, left and right in its picture; which pixel of `out` the first
            one is. Those of one camera follow each other.
        reach: nearest and farthest that is drawn, m.
        out: `[pixels, 3]` uint8; rows of a part follow each other.
    """
    widest = 0
    for k in range(parts.shape[0]):
        widest = max(widest, parts[k, 4] - parts[k, 3])
    facet, number = np.empty((corners.shape[0], 6, 3)), np.empty(corners.shape[0], np.int64)
    here, rows = np.empty(corners.shape[0], np.int64), np.empty((corners.shape[0], 2), np.int64)
    ends = np.empty((corners.shape[0], 2, 5, 2))
    nearest, which, line = np.empty(widest, np.float32), np.empty(widest, np.int32), np.empty(widest, np.uint32)
    ramp = np.arange(widest).astype(np.float32)
    across, up = np.empty(widest, np.float32), np.empty(widest, np.float32)
    square, sizes = np.empty(widest, np.float32), np.empty(widest, np.int32)
    bits, aimed, count = square.view(np.int32), np.int64(-1), 0
    for k in range(parts.shape[0]):
        camera, top, bottom, left, right = parts[k, 0], parts[k, 1], parts[k, 2], parts[k, 3], parts[k, 4]
        start = parts[k, 5]
        if camera != aimed:
            count, aimed = facets(corners, cameras[camera], reach[0], facet, number), camera
        some, width = 0, right - left
        for n in range(count):
            if bounds(facet[n], (top, bottom, left, right), reach, rows[some], ends[some]):
                here[some] = n
                some += 1
        for row in range(top, bottom):
            cover(facet, here[:some], rows, ends, row, left, ramp, nearest[:width], which[:width])
            x = 0
            while x < width:
                end, n = x + 1, which[x]
                while end < width and which[end] == n:
                    end += 1
                if n < 0 or surface[number[n]] < 0:
                    line[x:end] = 0 if n < 0 else -1 - surface[number[n]]
                else:
                    copy = copies[surface[number[n]]]
                    u, v = across[x:end], up[x:end]
                    walk(facet[n], row, left + x, copy[0], ramp, u, v, square[x:end])
                    paint(u, v, bits[x:end], sizes[x:end], texels, copy, line[x:end])
                x = end
            unpack(line, out[start : start + width])
            start += width


@jit
def cover(
    facet: Array, here: Array, rows: Array, ends: Array, row: int, left: int, ramp: Array, nearest: Array, which: Array
) -> None:
    """The nearest triangle at every column of a row, -1 where there is none."""
    nearest[:] = 0
    which[:] = -1
    for k in range(here.shape[0]):
        if not rows[k, 0] <= row < rows[k, 1]:
            continue
        n = here[k]
        first, end = span(ends[k], row)
        if first < end:
            slope = facet[n, 3, 0]
            begin = slope * first + facet[n, 3, 1] * row + facet[n, 3, 2]
            nearer(f32(slope), f32(begin), i32(n), ramp, nearest[first - left : end - left], which[first - left :])


@jit
def nearer(slope: float, begin: float, n: int, ramp: Array, nearest: Array, which: Array) -> None:
    """Where this triangle is nearer than others so far."""
    for x in range(nearest.shape[0]):
        here = slope * ramp[x] + begin
        which[x] = n if here > nearest[x] else which[x]
        nearest[x] = max(here, nearest[x])


@jit
def walk(facet: Array, row: int, left: int, copy: Array, ramp: Array, u: Array, v: Array, square: Array) -> None:
    """Places in a triangle's picture along some columns of a row, see `step`."""
    wide, high = f32(copy[1]), f32(copy[2])
    depth, across, up = facet[3], facet[4], facet[5]
    q, s = depth[0] * left + depth[1] * row + depth[2], across[0] * left + across[1] * row + across[2]
    t = up[0] * left + up[1] * row + up[2]
    # Whole pictures are taken off before numbers are rounded to 24 bits.
    whole, whole_up = np.floor(s / q), np.floor(t / q)
    along = (f32(depth[0]), f32(across[0] - whole * depth[0]), f32(up[0] - whole_up * depth[0]))
    down = (f32(depth[1]), f32(across[1] - whole * depth[1]), f32(up[1] - whole_up * depth[1]))
    step((f32(q), f32(s - whole * q), f32(t - whole_up * q)), along, down, (wide, high), ramp, u, v, square)


@jit
def step(
    begin: tuple[float, float, float],
    along: tuple[float, float, float],
    down: tuple[float, float, float],
    size: tuple[float, float],
    ramp: Array,
    u: Array,
    v: Array,
    square: Array,
) -> None:
    """Places in the picture, and how many texels a pixel spans there along its longer side, squared."""
    (q0, s0, t0), (qx, sx, tx), (qy, sy, ty), (wide, high) = begin, along, down, size
    for k in range(u.shape[0]):
        x = ramp[k]
        depth = f32(1) / (qx * x + q0)
        a, b = (sx * x + s0) * depth, (tx * x + t0) * depth
        u[k], v[k] = a - np.floor(a), b - np.floor(b)
        along_u, along_v = (sx - a * qx) * wide, (tx - b * qx) * high
        down_u, down_v = (sy - a * qy) * wide, (ty - b * qy) * high
        longer = max(along_u * along_u + along_v * along_v, down_u * down_u + down_v * down_v)
        square[k] = longer * depth * depth


@jit
def paint(u: Array, v: Array, bits: Array, sizes: Array, texels: Array, copies: Array, line: Array) -> None:
    """The colors of some columns, from the copies of a picture that fit.

    Args:
        bits: of the squares that `step` found, as int32.
        sizes: becomes twice the logarithm of those, in 256ths.
    """
    last = 0
    while last + 1 < copies.shape[0] and copies[last + 1, 1] > 0:
        last += 1
    least, most = logarithms(bits, i32(last << 8), sizes)
    if most == 0:
        one_copy(u, v, texels, copies[0], line)
        return
    first, end = 0, line.shape[0]
    while first < end:
        level, until = sizes[first] >> 8, end
        if least >> 8 != most >> 8:
            until = first + 1
            while until < end and sizes[until] >> 8 == level:
                until += 1
        pair = copies[min(level, last - 1) :]
        if level == last:
            one_copy(u[first:until], v[first:until], texels, copies[last], line[first:until])
        else:
            two_copies(u[first:until], v[first:until], sizes[first:until], texels, pair, line[first:until])
        first = until


@jit
def logarithms(bits: Array, most: Any, sizes: Array) -> tuple[Any, Any]:
    """Levels in 256ths, from 0 to `most`; the smallest and the largest of them."""
    low: Any = most
    high: Any = i32(0)
    for k in range(sizes.shape[0]):
        size = min(max(i32(i32(bits[k] - ONE) >> i32(16)), i32(0)), most)
        sizes[k] = size
        low, high = min(low, size), max(high, size)
    return low, high


@jit
def unpack(line: Array, pixels: Array) -> None:
    """Red, green and blue of every pixel beside each other, as cameras give them."""
    for x in range(pixels.shape[0]):
        pixels[x, 0], pixels[x, 1], pixels[x, 2] = u8(line[x]), u8(line[x] >> 8), u8(line[x] >> 16)
