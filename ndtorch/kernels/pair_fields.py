"""Weighted sums over fields of the magnitudes of two images that are the real and the imaginary part of one."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.utils.jit import jit


@jit
def pair_fields(responses: Array, places: Array, shares: Array, columns: Array, sums: Array) -> None:
    """For every filter and field, magnitudes of both grids times the weights of their places, added up.

    Args:
        responses: `[F, R, 2 C]`, real and imaginary parts in turn.
        places: the two rows of fields to which a row of each grid belongs, `[2, R, 2]`.
        shares: how much, `[2, R, 2]`.
        columns: weights in each column of fields, of the points of each grid, and zero for those of the other,
            `[2, C', 2 C]`.
        sums: `[F, R', C']`.
    """
    count, height, width = responses.shape
    bands = np.empty((2, sums.shape[1], width), responses.dtype)
    for f in range(count):
        bands[:] = 0
        for r in range(height):
            for grid in range(2):
                one, other = places[grid, r, 0], places[grid, r, 1]
                add_magnitudes(responses[f, r], shares[grid, r], bands[grid, one], bands[grid, other])
        for row in range(sums.shape[1]):
            for column in range(sums.shape[2]):
                total = responses.dtype.type(0)
                for grid in range(2):
                    band, weights = bands[grid, row], columns[grid, column]
                    for c in range(width):
                        total += band[c] * weights[c]
                sums[f, row, column] = total


@jit
def add_magnitudes(line: Array, shares: Array, above: Array, below: Array) -> None:
    """Add the magnitudes of a line to two bands."""
    one, other = shares[0], shares[1]
    for c in range(line.shape[0]):
        size = abs(line[c])
        above[c] += one * size
        below[c] += other * size
