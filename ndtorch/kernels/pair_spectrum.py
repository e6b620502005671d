"""From the spectrum of an image to those of its responses on two grids, as one complex spectrum a filter."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array


def pair_spectrum(columns: Array, filters: Array, out: Array) -> None:
    """Cut the low rows out of a half spectrum and multiply them, and their mirror images, with every filter.

    Args:
        columns: spectrum of a real image, `[N, C / 2 + 1]`.
        filters: `[F, R, C]`, of the first grid plus i times that of the second.
        out: `[F, R, C]`: the real part of its inverse transform are the responses on the first grid, the imaginary
            part those on the second.
    """
    count, rows, full = filters.shape
    length, half = columns.shape
    above = rows - (rows - 1) // 2
    line = np.empty(full, columns.dtype)
    for r in range(rows):
        place = r if r < above else length - rows + r
        back = rows - r if r else 0
        mirrored = back if back < above else length - rows + back
        for c in range(half):
            line[c] = columns[place, c]
        for c in range(half, full):
            line[c] = columns[mirrored, full - c].conjugate()
        for f in range(count):
            for c in range(full):
                out[f, r, c] = line[c] * filters[f, r, c]
