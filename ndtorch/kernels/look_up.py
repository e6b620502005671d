"""What a table says of the number of every pixel."""

from __future__ import annotations

from ndtorch.kernels.any_of import any_of
from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def look_up(numbers: Array, table: Array, found: Array) -> None:
    """`table[numbers]` into `found`, `[h, w]`."""
    for y in range(numbers.shape[0]):
        if not any_of(numbers[y]):
            found[y] = table[0]
            continue
        for x in range(numbers.shape[1]):
            found[y, x] = table[numbers[y, x]]
