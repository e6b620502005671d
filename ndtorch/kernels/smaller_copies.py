"""A picture and its smaller copies, each half as large as the one before: as a driver of OpenGL makes mipmaps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ndtorch.kernels.texture_sample import BYTE, PAIR, mix
from ndtorch.utils.jit import jit

Array = Any

u32 = np.uint32


@jit
def smaller_copies(image: Array, copies: Array, texels: Array) -> None:
    """Write all copies of a picture, each with a border of one texel that goes on at the other side.

    Args:
        image: red, green and blue of its texels, row by row, uint8.
        copies: where each begins, its width and its height, `[L, 3]`; none where the width is 0.
        texels: see `level` of `texture_sample`.
    """
    start, wide, high = copies[0, 0], copies[0, 1], copies[0, 2]
    at = 0
    for y in range(high):
        here = start + (y + 1) * (wide + 2) + 1
        for x in range(wide):
            texels[here + x] = u32(image[at]) | u32(image[at + 1]) << BYTE | u32(image[at + 2]) << u32(16)
            at += 3
    border(texels, start, wide, high)
    for k in range(1, copies.shape[0]):
        if copies[k, 1] > 0:
            halve(texels, copies[k - 1], copies[k])
            border(texels, copies[k, 0], copies[k, 1], copies[k, 2])


@jit
def border(texels: Array, start: int, wide: int, high: int) -> None:
    """Repeat the other side at each side."""
    stride = wide + 2
    for y in range(1, high + 1):
        row = start + y * stride
        texels[row], texels[row + wide + 1] = texels[row + wide], texels[row + 1]
    for x in range(stride):
        texels[start + x] = texels[start + high * stride + x]
        texels[start + (high + 1) * stride + x] = texels[start + stride + x]


@jit
def between(k: int, few: int, many: int) -> tuple[int, int, int]:
    """Which two of many stand for one of few, and of the second so many 256ths."""
    place = (k + 0.5) * many / few - 0.5
    low = math.floor(place)
    return max(low, 0), min(low + 1, many - 1), math.floor((place - low) * 256 + 0.5)


@jit
def halve(texels: Array, large: Array, small: Array) -> None:
    """Fill a copy from the one before."""
    start, stride = large[0], large[1] + 2
    for y in range(small[2]):
        above, below, down = between(y, small[2], large[2])
        upper, lower = start + (above + 1) * stride + 1, start + (below + 1) * stride + 1
        here = small[0] + (y + 1) * (small[1] + 2) + 1
        for x in range(small[1]):
            left, right, along = between(x, small[1], large[1])
            a, b, c, d = texels[upper + left], texels[upper + right], texels[lower + left], texels[lower + right]
            share, down_share = u32(along), u32(down)
            above_both = mix(u32(a & PAIR), u32(b & PAIR), share)
            below_both = mix(u32(c & PAIR), u32(d & PAIR), share)
            above_green = mix(u32(u32(a >> BYTE) & PAIR), u32(u32(b >> BYTE) & PAIR), share)
            below_green = mix(u32(u32(c >> BYTE) & PAIR), u32(u32(d >> BYTE) & PAIR), share)
            both, green = mix(above_both, below_both, down_share), mix(above_green, below_green, down_share)
            texels[here + x] = u32(both | u32(green << BYTE))
