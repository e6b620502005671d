"""The colors of a picture, which lie beside each other, as pictures of their own."""

from __future__ import annotations

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def apart_colors(picture: Array, unit: float, planes: Array) -> None:
    """Whole numbers as shares of full scale.

    Args:
        picture: `[h, w, 3]` uint8.
        unit: becomes of 1.
        planes: become the three colors, `[3, h, w]`.
    """
    _, height, width = planes.shape
    kind = planes.dtype.type
    one = kind(unit)
    for y in range(height):
        row, red, green, blue = picture[y], planes[0, y], planes[1, y], planes[2, y]
        for x in range(width):
            red[x] = kind(row[x, 0]) * one
            green[x] = kind(row[x, 1]) * one
            blue[x] = kind(row[x, 2]) * one
