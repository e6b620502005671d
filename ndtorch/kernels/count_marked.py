"""How many pixels of every region there are, and how many of them are marked."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.any_of import any_of
from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def count_marked(labels: Array, marked: Array, counts: Array, areas: Array) -> None:
    """Adds the marks, 0 or 1, and the number of the pixels `[h, w]` of every label, `[N]`."""
    some, rest = 0, 0
    for y in range(labels.shape[0]):
        if not any_of(labels[y]):
            some += count_of(marked[y])
            rest += labels.shape[1]
            continue
        for x in range(labels.shape[1]):
            number = labels[y, x]
            # Most pixels are in none: to add all those to one place in memory takes several times as long.
            if number == 0:
                some += marked[y, x]
                rest += 1
                continue
            counts[number] += marked[y, x]
            areas[number] += 1
    counts[0] += some
    areas[0] += rest


@jit
def count_of(marked: Array) -> int:
    """How many of a row are marked."""
    count = np.int32(0)
    for x in range(marked.shape[0]):
        count += np.int32(marked[x])
    return int(count)
