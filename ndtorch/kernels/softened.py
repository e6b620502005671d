"""Every color blurred by a square of three by three pixels."""

from __future__ import annotations

import numpy as np

from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def softened(picture: Array, soft: Array) -> None:
    """What `cv2.blur` does: sums in float64, and beyond its edges the picture goes on mirrored.

    Args:
        picture: `[C, h, w]`, two rows and columns or more.
        soft: becomes the blurred picture, likewise.
    """
    _, height, width = picture.shape
    line = np.empty(width + 2)
    for c in range(picture.shape[0]):
        for y in range(height):
            above, below = picture[c, abs(y - 1)], picture[c, y + 1 if y + 1 < height else y - 1]
            down(above, picture[c, y], below, line[1 : width + 1])
            line[0], line[width + 1] = line[2], line[width - 1]
            across(line, soft[c, y])


@jit(exact=True)
def down(above: Array, here: Array, below: Array, line: Array) -> None:
    """Sums of three rows."""
    for x in range(line.shape[0]):
        line[x] = np.float64(above[x]) + np.float64(here[x]) + np.float64(below[x])


@jit(exact=True)
def across(line: Array, soft: Array) -> None:
    """Means of three neighbours in such sums."""
    ninth = 1.0 / 9.0
    for x in range(soft.shape[0]):
        soft[x] = np.float32((line[x] + line[x + 1] + line[x + 2]) * ninth)
