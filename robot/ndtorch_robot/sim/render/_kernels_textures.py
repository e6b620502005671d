"""Textures: mipmaps, and colors between texels with the eight-bit arithmetic of OpenGL drivers.

Two channels of a color lie in one number, 16 bits apart, so that one product weighs both.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ndtorch.utils.jit import jit

Array = Any

u32, i32, f32 = np.uint32, np.int32, np.float32
PAIR, BYTE, HALF, ALL = u32(0xFF00FF), u32(8), u32(0x800080), u32(256)
MIDDLE = f32(128.5)
"""Half a texel of the border, and half a unit to round with, in 256ths of a texel."""


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
def build_mipmaps(image: Array, mipmaps: Array, texels: Array) -> None:
    """Write all mipmaps of a texture, each with a border of one texel that repeats its opposite side.

    Args:
        image: red, green and blue of its texels, row by row, uint8.
        mipmaps: where each begins, its width and its height, `[L, 3]`; a width of 0 is none.
        texels: see `bilinear`.
    """
    start, wide, high = mipmaps[0, 0], mipmaps[0, 1], mipmaps[0, 2]
    at = 0
    for y in range(high):
        here = start + (y + 1) * (wide + 2) + 1
        for x in range(wide):
            texels[here + x] = u32(image[at]) | u32(image[at + 1]) << BYTE | u32(image[at + 2]) << u32(16)
            at += 3
    border(texels, start, wide, high)
    for k in range(1, mipmaps.shape[0]):
        if mipmaps[k, 1] > 0:
            downsample(texels, mipmaps[k - 1], mipmaps[k])
            border(texels, mipmaps[k, 0], mipmaps[k, 1], mipmaps[k, 2])


@jit
def border(texels: Array, start: int, wide: int, high: int) -> None:
    """Fill the border of a mipmap with its opposite sides."""
    stride = wide + 2
    for y in range(1, high + 1):
        row = start + y * stride
        texels[row], texels[row + wide + 1] = texels[row + wide], texels[row + 1]
    for x in range(stride):
        texels[start + x] = texels[start + high * stride + x]
        texels[start + (high + 1) * stride + x] = texels[start + stride + x]


@jit
def neighbours(k: int, few: int, many: int) -> tuple[int, int, int]:
    """Which two of `many` texels make one of `few`, and the weight of the second in 256ths."""
    place = (k + 0.5) * many / few - 0.5
    low = math.floor(place)
    return max(low, 0), min(low + 1, many - 1), math.floor((place - low) * 256 + 0.5)


@jit
def downsample(texels: Array, large: Array, small: Array) -> None:
    """Fill a mipmap from the next larger one."""
    start, stride = large[0], large[1] + 2
    for y in range(small[2]):
        above, below, down = neighbours(y, small[2], large[2])
        upper, lower = start + (above + 1) * stride + 1, start + (below + 1) * stride + 1
        here = small[0] + (y + 1) * (small[1] + 2) + 1
        for x in range(small[1]):
            left, right, along = neighbours(x, small[1], large[1])
            a, b, c, d = texels[upper + left], texels[upper + right], texels[lower + left], texels[lower + right]
            share, down_share = u32(along), u32(down)
            above_both = mix(u32(a & PAIR), u32(b & PAIR), share)
            below_both = mix(u32(c & PAIR), u32(d & PAIR), share)
            above_green = mix(u32(u32(a >> BYTE) & PAIR), u32(u32(b >> BYTE) & PAIR), share)
            below_green = mix(u32(u32(c >> BYTE) & PAIR), u32(u32(d >> BYTE) & PAIR), share)
            both, green = mix(above_both, below_both, down_share), mix(above_green, below_green, down_share)
            texels[here + x] = u32(both | u32(green << BYTE))
