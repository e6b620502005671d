"""Colors between the texels of a picture and its smaller copies, with the arithmetic of eight bits of OpenGL drivers.

Two channels of a color lie in one number, 16 bits apart, so that one product weighs both.
"""

from __future__ import annotations

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
    """`a` and `b`, of `b` so many 256ths, rounded; two channels each."""
    weighed = u32(u32(a * u32(ALL - share)) + u32(b * share))
    mixed: Any = u32(u32(u32(weighed + HALF) >> BYTE) & PAIR)
    return mixed


@jit
def level(u: float, v: float, texels: Array, start: int, stride: int, wide: float, high: float) -> tuple[Any, Any]:
    """One copy of a picture at a place: red with blue, and green.

    Args:
        u, v: 0..1 of its width and height.
        texels: `[N]` uint32: red, green, blue from the lowest byte; a border of one texel is around each copy.
        start, stride: where the copy begins, and texels from row to row.
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
def one_copy(u: Array, v: Array, texels: Array, copy: Array, line: Array) -> None:
    """Colors `[n]` from one copy of a picture.

    Args:
        copy: where it starts, its width and its height in texels, `[3]` int32.
    """
    start, stride = copy[0], i32(copy[1] + 2)
    wide, high = f32(copy[1] * 256), f32(copy[2] * 256)
    for k in range(line.shape[0]):
        both, green = level(u[k], v[k], texels, start, stride, wide, high)
        line[k] = u32(both | u32(green << BYTE))


@jit
def two_copies(u: Array, v: Array, shares: Array, texels: Array, copies: Array, line: Array) -> None:
    """Colors `[n]` between two copies of a picture.

    Args:
        shares: of the second copy, 256ths in the lowest eight bits, `[n]` int32.
        copies: as `copy` of `one_copy`, `[2, 3]`.
    """
    start, stride = copies[0, 0], i32(copies[0, 1] + 2)
    wide, high = f32(copies[0, 1] * 256), f32(copies[0, 2] * 256)
    next_start, next_stride = copies[1, 0], i32(copies[1, 1] + 2)
    next_wide, next_high = f32(copies[1, 1] * 256), f32(copies[1, 2] * 256)
    for k in range(line.shape[0]):
        both, green = level(u[k], v[k], texels, start, stride, wide, high)
        small, small_green = level(u[k], v[k], texels, next_start, next_stride, next_wide, next_high)
        share = u32(shares[k] & 255)
        line[k] = u32(mix(both, small, share) | u32(mix(green, small_green, share) << BYTE))
