"""How much stands out that has been still."""

from __future__ import annotations

from ndtorch.kernels.any_of import any_of
from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def still_of(figure: Array, quiet: Array, least: float, silhouettes: Array, moving: Array) -> int:
    """How many pixels stand out, have been still for at least that long, and are no part of what moves.

    Args:
        figure: what stands out, `[h, w]` bool.
        quiet: seconds without motion, `[h, w]`.
        least: such seconds.
        silhouettes: number of the track of every pixel plus one, `[h, w]` int32.
        moving: 1 for those that move, by that number, `[n]` uint8.
    """
    count = 0
    for y in range(figure.shape[0]):
        for x in range(figure.shape[1] if any_of(figure[y]) else 0):
            if figure[y, x] and quiet[y, x] >= least:
                count += moving[silhouettes[y, x]] == 0
    return count
