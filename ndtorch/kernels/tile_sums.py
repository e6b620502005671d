"""Adding weights to cells of a few tiles."""

from __future__ import annotations

from typing import Any

from ndtorch.utils.jit import jit

Array = Any


@jit
def tile_sums(numbers: Array, weights: Array, slots: Array, tiles: Array) -> None:
    """Add weights to the cells of those numbers.

    Args:
        slots: where in `tiles` each tile of the grid is, `[count]`.
        tiles: `[touched, cells of a tile]`.
    """
    cells = tiles.shape[1]
    for i in range(numbers.shape[0]):
        tile = numbers[i] // cells
        tiles[slots[tile], numbers[i] - tile * cells] += weights[i]
