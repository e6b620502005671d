"""Weighted sums of magnitudes of two images that are the real and the imaginary part of one."""

from __future__ import annotations

from ndtorch.kernels.filters import Array
from ndtorch.utils.jit import jit


@jit
def pair_sums(responses: Array, weights: Array, sums: Array) -> None:
    """For every image and filter, magnitudes of both grids times the weights of their places, added up.

    Args:
        responses: `[T, F, R, 2 C]`, real and imaginary parts in turn.
        weights: `[R, 2 C]`, of both grids in turn.
        sums: `[T, F]`.
    """
    times, count, height, width = responses.shape
    for t in range(times):
        for f in range(count):
            total = 0.0
            for r in range(height):
                line, shares, part = responses[t, f, r], weights[r], responses.dtype.type(0)
                for c in range(width):
                    part += abs(line[c]) * shares[c]
                total += part
            sums[t, f] = total
