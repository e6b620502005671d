"""Ways for a car that cannot turn on the spot: the two searches, compiled by numba when first called.

Import this file only where a search is wanted: numba takes half a second to load.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

Floats = npt.NDArray[np.float32]

HEADINGS = 24
"""Headings that the lattice tells apart."""


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def look(grid: Floats, x: float, y: float, left: float, bottom: float, cell: float) -> float:
    """The value of the cell at a place; -1 outside."""
    row, column = int((y - bottom) / cell), int((x - left) / cell)
    if x < left or y < bottom or row >= grid.shape[0] or column >= grid.shape[1]:
        return -1.0
    return float(grid[row, column])


@njit(cache=True)
def room(clear: Floats, x: float, y: float, th: float, discs: Floats, left: float, bottom: float, cell: float) -> float:
    """The least clearance of the discs that stand for the body."""
    cos, sin = math.cos(th), math.sin(th)
    best = 1e9
    for d in discs:
        best = min(best, look(clear, x + d * cos, y + d * sin, left, bottom, cell))
    return best


@njit(cache=True)
def find_way(
    clear: Floats,
    unknown: Floats,
    heuristic: Floats,
    left: float,
    bottom: float,
    cell: float,
    coarse: float,
    start: Floats,
    bends: Floats,
    discs: Floats,
    step: float,
    horizon: float,
    hard: float,
    soft: float,
    tight_price: float,
    unknown_price: float,
    bend_price: float,
    swing_price: float,
    reverse_price: float,
    switch_price: float,
    most: int,
) -> Floats:
    """The best way on a lattice of arcs (A*), from a pose to where `horizon` metres are driven.

    Args:
        clear: distance to what is blocked, m, `[R, C]`; unknown: 1 where nothing is known.
        heuristic: `cost_to_go` on cells of `coarse` metres, with the same lower left corner.
        start: x, y, heading, curvature and direction (+1 or -1) now.
        bends: curvatures of the arcs, 1/m.
        discs: middles of the discs that stand for the body, along it, m.
        step: length of an arc, m.
        hard, soft: the discs keep `hard` metres away, and nearer than `soft` costs up to `tight_price` a metre more.
        unknown_price, bend_price: of a metre more, and of a unit of curvature a metre.
        swing_price: of a change of the curvature by one unit.
        reverse_price, switch_price: of a metre backward, and of changing the direction.
        most: nodes looked at.

    Returns:
        `[n, 5]`: x, y, heading, curvature driven to there, direction; the first row is the start. One row only: no way.
    """
    reach = horizon + 1.0
    side = int(2 * reach / 0.1) + 1
    seen = np.full(side * side * HEADINGS * 2, np.inf, np.float32)
    kept = most + 16
    node = np.empty((kept, 5), np.float32)
    parent = np.empty(kept, np.int32)
    gone = np.empty(kept, np.float32)
    driven = np.empty(kept, np.float32)
    heap, items = np.empty(kept, np.float32), np.empty(kept, np.int32)
    node[0] = start
    parent[0], gone[0], driven[0] = -1, 0.0, 0.0
    count = push(heap, items, 0, 0.0, 0)
    made, best, best_value = 1, 0, np.inf
    first_room = room(clear, start[0], start[1], start[2], discs, left, bottom, cell)
    end = -1
    popped = 0
    while count > 0 and made < most:
        n = items[0]
        count = pop(heap, items, count)
        popped += 1
        x, y, th, k, way = node[n]
        far = look(heuristic, x, y, left, bottom, coarse)
        if driven[n] > 0.35 and far >= 0 and far + 0.3 * gone[n] < best_value:
            best, best_value = n, far + 0.3 * gone[n]
        if far >= 0 and (driven[n] >= horizon or far < 0.15) and way > 0:
            end = n
            break
        for backward in range(2):
            to = -1.0 if backward else 1.0
            for bend in bends:
                if backward and bend != 0.0 and abs(bend) < 1.9:
                    continue
                # Half of the arc, then all of it.
                turned = bend * step * to
                chord = step * (math.sin(turned / 2) / (turned / 2) if abs(turned) > 1e-6 else 1.0) * to
                half = step / 2 * to
                mx, my = x + half * math.cos(th + turned / 4), y + half * math.sin(th + turned / 4)
                nx, ny = x + chord * math.cos(th + turned / 2), y + chord * math.sin(th + turned / 2)
                nth = th + turned
                near = min(
                    room(clear, mx, my, th + turned / 2, discs, left, bottom, cell),
                    room(clear, nx, ny, nth, discs, left, bottom, cell),
                )
                # Who stands too near may leave, but not go nearer.
                if near < hard and not (driven[n] < 0.5 and near >= first_room and near > 0):
                    continue
                if backward and look(unknown, nx, ny, left, bottom, cell) > 0:
                    continue
                price = 1.0 + bend_price * abs(bend)
                if near < soft:
                    price += tight_price * (soft - near) / (soft - hard)
                if look(unknown, nx + 0.25 * math.cos(nth), ny + 0.25 * math.sin(nth), left, bottom, cell) > 0:
                    price += unknown_price
                if backward:
                    price *= reverse_price
                g = gone[n] + price * step + swing_price * abs(bend - k)
                if to != way:
                    g += switch_price
                h = look(heuristic, nx, ny, left, bottom, coarse)
                if h < 0 or h == np.inf:
                    continue
                i, j = int((nx - start[0] + reach) / 0.1), int((ny - start[1] + reach) / 0.1)
                if i < 0 or j < 0 or i >= side or j >= side:
                    continue
                t = math.floor((nth / (2 * math.pi)) * HEADINGS + 0.5) % HEADINGS
                place = ((j * side + i) * HEADINGS + t) * 2 + backward
                if g >= seen[place] - 1e-4 or made >= kept:
                    continue
                seen[place] = g
                node[made] = np.array((nx, ny, nth, bend, to), np.float32)
                parent[made], gone[made], driven[made] = n, g, driven[n] + step
                count = push(heap, items, count, g + h, made)
                made += 1
    if end < 0:
        end = best
    length = 1
    n = end
    while parent[n] >= 0:
        n = parent[n]
        length += 1
    way_ = np.empty((length, 5), np.float32)
    n = end
    for m in range(length - 1, -1, -1):
        way_[m] = node[n]
        n = parent[n]
    return way_
