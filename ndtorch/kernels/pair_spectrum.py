"""From the spectrum of an image to those of its responses on two grids, as one complex spectrum a filter."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.utils.jit import jit


@jit
def pair_spectrum(columns: Array, filters: Array, out: Array) -> None:
    """Cut the low rows out of half spectra and multiply them, and their mirror images, with every filter.

    Args:
        columns: spectra of real images, real and imaginary parts last, `[T, N, C / 2 + 1, 2]`.
        filters: real and imaginary parts, `[2, F, R, C]`, of the first grid plus i times that of the second.
        out: conjugates of the products, `[T, F, R, C, 2]`: the real part of a transform of them are the responses on
            the first grid, the imaginary part those on the second, with the other sign.
    """
    _, count, rows, full = filters.shape
    times, length, half, _ = columns.shape
    above = rows - (rows - 1) // 2
    real, imaginary = np.empty(full, columns.dtype), np.empty(full, columns.dtype)
    for t in range(times):
        for r in range(rows):
            place = r if r < above else length - rows + r
            back = rows - r if r else 0
            mirrored = back if back < above else length - rows + back
            here, there = columns[t, place], columns[t, mirrored]
            for c in range(half):
                real[c], imaginary[c] = here[c, 0], here[c, 1]
            for c in range(half, full):
                real[c], imaginary[c] = there[full - c, 0], -there[full - c, 1]
            for f in range(count):
                one, other, to = filters[0, f, r], filters[1, f, r], out[t, f, r]
                for c in range(full):
                    to[c, 0] = real[c] * one[c] - imaginary[c] * other[c]
                    to[c, 1] = -(real[c] * other[c] + imaginary[c] * one[c])
