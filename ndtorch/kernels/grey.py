"""Grey of a row of pixels, from frames of any kind."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch.utils.jit import jit

Array = Any


@jit
def grey_row(frame: Array, beside: bool, y: int, left: int, every: int, unit: float, count: int, grey: Array) -> None:
    """Every so many pixels of row `y` from column `left` on: sum of colors times `unit`, over `count`.

    Args:
        frame: `[C, H, W]`, or `[H, W, C]` where colors lie `beside` each other; without gaps.
    """
    kind, pixels = grey.dtype.type, frame.reshape(-1)
    if beside:
        _, width, colors = frame.shape
        step, plane = colors, 1
    else:
        colors, height, width = frame.shape
        step, plane = 1, height * width
    start, more = np.uintp((y * width + left) * step), np.uintp(plane)
    # One color stands for three.
    scale, over = kind(unit), kind(count if colors > 1 else 3 * count)
    if colors != 3:
        middle, last = np.uintp(colors // 2) * more, np.uintp(colors - 1) * more
        grey_strided(pixels, start, np.uintp(every * step), middle, last, scale, over, grey)
    elif beside and every == 1:
        grey_strided(pixels, start, np.uintp(3), np.uintp(1), np.uintp(2), scale, over, grey)
    elif beside and every == 2:
        grey_strided(pixels, start, np.uintp(6), np.uintp(1), np.uintp(2), scale, over, grey)
    elif every == 1:
        grey_strided(pixels, start, np.uintp(1), more, more + more, scale, over, grey)
    elif every == 2:
        grey_strided(pixels, start, np.uintp(2), more, more + more, scale, over, grey)
    else:
        grey_strided(pixels, start, np.uintp(every * step), more, more + more, scale, over, grey)


@jit
def grey_strided(
    pixels: Array, start: Any, step: Any, middle: Any, last: Any, unit: float, over: float, grey: Array
) -> None:
    """Grey of pixels that are `step` places apart and whose other colors are `middle` and `last` places on.

    Called with constants, it is inlined and becomes vector instructions.
    """
    kind = grey.dtype.type
    if over == kind(1):
        for x in range(grey.shape[0]):
            k = start + step * np.uintp(x)
            grey[x] = (kind(pixels[k]) + kind(pixels[k + middle]) + kind(pixels[k + last])) * unit
    else:
        for x in range(grey.shape[0]):
            k = start + step * np.uintp(x)
            grey[x] = (kind(pixels[k]) + kind(pixels[k + middle]) + kind(pixels[k + last])) * unit / over
