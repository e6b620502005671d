"""What the two searches for ways share: a heap of two arrays, and looking into a grid of cells."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float32]


@jit
def push(heap: Floats, items: npt.NDArray[np.int32], count: int, key: float, item: int) -> int:
    """Put an item into a binary heap of two arrays; returns how many it holds."""
    k = count
    while k > 0:
        up = (k - 1) >> 1
        if heap[up] <= key:
            break
        heap[k], items[k] = heap[up], items[up]
        k = up
    heap[k], items[k] = key, item
    return count + 1


@jit
def pop(heap: Floats, items: npt.NDArray[np.int32], count: int) -> int:
    """Take the first item, which the caller has read, out of the heap; returns how many it holds then."""
    count -= 1
    key, item = heap[count], items[count]
    k = 0
    while True:
        below = 2 * k + 1
        if below >= count:
            break
        if below + 1 < count and heap[below + 1] < heap[below]:
            below += 1
        if heap[below] >= key:
            break
        heap[k], items[k] = heap[below], items[below]
        k = below
    heap[k], items[k] = key, item
    return count


@jit
def look(grid: Floats, x: float, y: float, left: float, bottom: float, cell: float) -> float:
    """The value of the cell at a place; -1 outside."""
    row, column = int((y - bottom) / cell), int((x - left) / cell)
    if x < left or y < bottom or row >= grid.shape[0] or column >= grid.shape[1]:
        return -1.0
    return float(grid[row, column])


@jit
def room(clear: Floats, x: float, y: float, th: float, discs: Floats, left: float, bottom: float, cell: float) -> float:
    """The least clearance of the discs that stand for the body."""
    cos, sin = math.cos(th), math.sin(th)
    best = 1e9
    for d in discs:
        best = min(best, look(clear, x + d * cos, y + d * sin, left, bottom, cell))
    return best
