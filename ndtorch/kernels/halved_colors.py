"""A picture of bytes at half its height and width, its colors apart."""

from __future__ import annotations

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def halved_colors(picture: Array, unit: float, planes: Array) -> None:
    """Means of blocks of two by two pixels in whole numbers, as `cv2.resize` takes them, as shares of full scale.

    Args:
        picture: its colors lie beside each other, `[2 h, 2 w * 3]` uint8.
        unit: becomes of 1.
        planes: become the three colors, `[3, h, w]` float32.
    """
    sums = np.empty(picture.shape[1], np.int32)
    for y in range(planes.shape[1]):
        add(picture[2 * y], picture[2 * y + 1], sums)
        shares(sums, unit, planes[0, y], planes[1, y], planes[2, y])


@jit
def add(upper: Array, lower: Array, sums: Array) -> None:
    """Sums of two rows."""
    for n in range(sums.shape[0]):
        sums[n] = np.int32(upper[n]) + np.int32(lower[n])


@jit
def shares(sums: Array, unit: float, red: Array, green: Array, blue: Array) -> None:
    """Means of pairs of neighbours, color by color; halves are rounded up."""
    one, half, quarter = np.float32(unit), np.int32(2), np.int32(2)
    for x in range(red.shape[0]):
        k = 6 * x
        red[x] = np.float32((sums[k] + sums[k + 3] + half) >> quarter) * one
        green[x] = np.float32((sums[k + 1] + sums[k + 4] + half) >> quarter) * one
        blue[x] = np.float32((sums[k + 2] + sums[k + 5] + half) >> quarter) * one
