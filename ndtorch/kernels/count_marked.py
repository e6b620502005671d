"""How many pixels of every region there are, and how many of them are marked."""

from __future__ import annotations

from ndtorch.kernels.filters import Array


def count_marked(labels: Array, marked: Array, counts: Array, areas: Array) -> None:
    """Adds the marks, 0 or 1, and the number of the pixels `[h, w]` of every label, `[N]`."""
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            number = labels[y, x]
            counts[number] += marked[y, x]
            areas[number] += 1
