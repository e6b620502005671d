"""Bars painted into black frames, or into those of before: only pixels that a bar touches."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ndtorch.utils.jit import jit

Array = Any


@jit
def draw_bars(
    before: Array, centers: Array, sizes: Array, reach: Array, turns: Array, colors: Array, light: Array, canvas: Array
) -> None:
    """`BarScene.frames` of one scene.

    Args:
        before: centers of bars that were painted into the first of these frames and are wiped out, `[T', K, 2]`.
        centers: columns and rows of the bars, `[T, K, 2]` float64.
        sizes: widths and lengths, `[T, K, 2]` float64.
        reach: how far from its center a bar may touch a pixel, in columns and in rows, `[K, 2]` float64.
        turns: cosine and sine of its tilt, `[K, 2]` float64.
        colors: `[K, 3]`.
        light: factor on the color at each pixel, `[K, H or 1, W]`.
        canvas: `[T, 3, H, W]`.
    """
    kind, (times, _, height, width) = canvas.dtype.type, canvas.shape
    none, half, one = kind(0), 0.5, 1.0
    for t in range(before.shape[0]):
        for k in range(reach.shape[0]):
            left, top = math.ceil(before[t, k, 0] - reach[k, 0]), math.ceil(before[t, k, 1] - reach[k, 1])
            for c in range(3):
                for i in range(math.floor(2 * reach[k, 1]) + 1):
                    line = canvas[t, c, (top + i) % height]
                    for j in range(math.floor(2 * reach[k, 0]) + 1):
                        line[(left + j) % width] = none
    across_x, along_x = np.empty(width, canvas.dtype), np.empty(width, canvas.dtype)
    for t in range(times):
        for k in range(reach.shape[0]):
            left, top = math.ceil(centers[t, k, 0] - reach[k, 0]), math.ceil(centers[t, k, 1] - reach[k, 1])
            wide, tall = math.floor(2 * reach[k, 0]) + 1, math.floor(2 * reach[k, 1]) + 1
            cos, sin = turns[k, 0], turns[k, 1]
            for j in range(wide):
                aside = left - centers[t, k, 0] + j
                across_x[j], along_x[j] = aside * cos, -aside * sin
            edge, far = kind(sizes[t, k, 0] / 2 + half), kind(sizes[t, k, 1] / 2 + half)
            most, longest = kind(min(sizes[t, k, 0], one)), kind(min(sizes[t, k, 1], one))
            for i in range(tall):
                below = top - centers[t, k, 1] + i
                across_y, along_y = kind(-below * sin), kind(-below * cos)
                row = (top + i) % height
                lit = light[k, row if light.shape[1] > 1 else 0]
                for j in range(wide):
                    across = min(max(edge - abs(across_x[j] + across_y), none), most)
                    cover = across * min(max(far - abs(along_x[j] + along_y), none), longest)
                    if cover > none:
                        column = (left + j) % width
                        for c in range(3):
                            behind = canvas[t, c, row, column]
                            canvas[t, c, row, column] = behind + cover * (colors[k, c] * lit[column] - behind)
