"""Weighted sums of magnitudes of two images that are the real and the imaginary part of one."""

from __future__ import annotations

from ndtorch.kernels.filters import Array


def pair_sums(responses: Array, rows: Array, columns: Array, sums: Array) -> None:
    """For every filter, magnitudes of both grids times the weights of their places, added up.

    Args:
        responses: `[F, R, 2 C]`, real and imaginary parts in turn.
        rows: `[2, R]`.
        columns: `[2 C]`, of both grids in turn.
        sums: `[F]`.
    """
    count, height, width = responses.shape
    for f in range(count):
        total = 0.0
        for r in range(height):
            line = responses[f, r]
            even = odd = responses.dtype.type(0)
            for c in range(0, width // 2):
                even += abs(line[2 * c]) * columns[2 * c]
                odd += abs(line[2 * c + 1]) * columns[2 * c + 1]
            total += even * rows[0, r] + odd * rows[1, r]
        sums[f] = total
