"""How many pixels of every region are marked."""

from __future__ import annotations

from ndtorch.kernels.filters import Array


def count_marked(labels: Array, marked: Array, counts: Array) -> None:
    """Adds the marks, 0 or 1, of every pixel `[h, w]` to the count of its number, `[N]`."""
    for y in range(labels.shape[0]):
        for x in range(labels.shape[1]):
            counts[labels[y, x]] += marked[y, x]
