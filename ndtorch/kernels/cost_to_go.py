"""The least price of a way from every cell of a grid to where ways may end."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.ways import Floats, pop, push
from ndtorch.utils.jit import jit


@jit
def cost_to_go(price: Floats, seed: Floats, cell: float, here: int, beyond: float) -> Floats:
    """The least price of a way from every cell to a seed (Dijkstra, eight neighbours).

    Args:
        price: of a metre in each cell, `[rows, columns]`.
        seed: what ending in a cell costs; inf where no way may end.
        cell: side, m.
        here: number of the cell that asks; cells that cost more than `beyond` more than it stay inf.
    """
    rows, columns = price.shape
    cost = np.full(rows * columns, np.inf, np.float32)
    heap, items = np.empty(rows * columns * 8 + 8, np.float32), np.empty(rows * columns * 8 + 8, np.int32)
    flat, ends = price.ravel(), seed.ravel()
    count = 0
    for n in range(rows * columns):
        if ends[n] < np.inf:
            cost[n] = ends[n]
            count = push(heap, items, count, float(cost[n]), n)
    enough = np.inf
    while count > 0:
        key, n = heap[0], items[0]
        count = pop(heap, items, count)
        if key > cost[n]:
            continue
        if key > enough:
            break
        if n == here:
            enough = key + beyond
        row, column = n // columns, n % columns
        for down in range(-1, 2):
            for across in range(-1, 2):
                r, c = row + down, column + across
                if (down == 0 and across == 0) or r < 0 or c < 0 or r >= rows or c >= columns:
                    continue
                m = r * columns + c
                length = cell * (1.4142135 if down != 0 and across != 0 else 1.0)
                new = np.float32(key + length * 0.5 * (flat[n] + flat[m]))
                if new < cost[m]:
                    cost[m] = new
                    count = push(heap, items, count, float(new), m)
    for n in range(rows * columns):
        if cost[n] > enough:
            cost[n] = np.inf
    return cost.reshape(rows, columns)
