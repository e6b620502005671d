"""The tint of the light in a scene, and the brightest patch in it."""

from __future__ import annotations

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def brightest(picture: Array, ground: Array, every: int, dimmest: float, balance: Array) -> float:
    """What `ndtorch.binding.tracking.shades.Light` tells of a picture whose sides are multiples of a patch's.

    Args:
        picture, ground: `[3, h, w]`.
        every: side of a patch; of the ground one pixel of each is looked at for the tint.
        dimmest: smallest mean of a color.
        balance: becomes what makes the ground grey, `[3]`.

    Returns:
        How bright the brightest patch is.
    """
    _, height, width = picture.shape
    kind = picture.dtype.type
    mean = 0.0
    for c in range(3):
        total = 0.0
        for y in range(0, height, every):
            for x in range(0, width, every):
                total += ground[c, y, x]
        balance[c] = max(total / ((height // every) * (width // every)), dimmest)
        mean += balance[c] / 3
    for c in range(3):
        balance[c] = mean / balance[c]
    red, green, blue = balance[0], balance[1], balance[2]
    most, line = kind(0), np.empty(width, picture.dtype)
    for which in range(2):
        image = ground if which else picture
        for top in range(0, height, every):
            line[:] = 0
            for y in range(top, top + every):
                add_bright(image[0, y], image[1, y], image[2, y], (red, green, blue), line)
            for left in range(0, width, every):
                sum_of = kind(0)
                for x in range(left, left + every):
                    sum_of += line[x]
                most = max(most, sum_of)
    return float(most) / (3 * every * every)


@jit
def add_bright(red: Array, green: Array, blue: Array, balance: tuple[float, float, float], line: Array) -> None:
    """Add the brightness of a row."""
    for x in range(line.shape[0]):
        line[x] += balance[0] * red[x] + balance[1] * green[x] + balance[2] * blue[x]
