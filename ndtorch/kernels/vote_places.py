"""How well a pattern of points fits a picture of walls, for every place of the picture."""

from __future__ import annotations

import math
from typing import Any

import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[Any]


@jit
def vote_places(picture: Floats, x: Floats, y: Floats, stride: int, out: Floats) -> None:
    """Fill `out` `[rows, columns]`: the mean of the picture at the points, with their origin at every n-th pixel.

    Args:
        picture: 0..1; nothing is outside.
        x, y: points in pixels, along columns and rows, `[n]`.
        stride: n.
    """
    rows, columns = picture.shape
    for n in range(len(x)):
        dx, dy = math.floor(x[n] + 0.5), math.floor(y[n] + 0.5)
        for i in range(out.shape[0]):
            row = i * stride + dy
            if 0 <= row < rows:
                for j in range(out.shape[1]):
                    column = j * stride + dx
                    if 0 <= column < columns:
                        out[i, j] += picture[row, column]
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] /= len(x)
