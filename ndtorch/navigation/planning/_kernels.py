"""Kernels of planning: Dijkstra on a costmap and A* on a lattice of arcs, with a binary heap."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float32]
Items = npt.NDArray[np.int32]

HEADINGS = 24
"""Headings of the lattice."""

NODE_M = 0.1
"""Side of the squares in which nodes of the lattice count as the same place."""

EXIT_M = 0.5
"""A car that is too near to an obstacle may leave within this distance, but not go nearer."""

NOSE_M = 0.25
"""Unknown cells are looked for this far ahead of the body's origin."""


@jit
def heap_push(heap: Floats, items: Items, count: int, key: float, item: int) -> int:
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
def heap_pop(heap: Floats, items: Items, count: int) -> int:
    """Remove the first item, which the caller has read; returns how many the heap holds then."""
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
def dijkstra(cost: Floats, goal: Floats, cell_m: float, start: int, beyond: float) -> Floats:
    """The least cost of a path from every cell to a goal, over eight neighbours.

    Args:
        cost: of a metre in each cell, `[rows, columns]`.
        goal: cost of ending in a cell; inf where no path may end.
        cell_m: side of a cell.
        start: index of the cell of the car; cells that cost more than `beyond` more than it stay inf.
    """
    rows, columns = cost.shape
    to_go = np.full(rows * columns, np.inf, np.float32)
    heap, items = np.empty(rows * columns * 8 + 8, np.float32), np.empty(rows * columns * 8 + 8, np.int32)
    flat, ends = cost.ravel(), goal.ravel()
    count = 0
    for n in range(rows * columns):
        if ends[n] < np.inf:
            to_go[n] = ends[n]
            count = heap_push(heap, items, count, float(to_go[n]), n)
    enough = np.inf
    while count > 0:
        key, n = heap[0], items[0]
        count = heap_pop(heap, items, count)
        if key > to_go[n]:
            continue
        if key > enough:
            break
        if n == start:
            enough = key + beyond
        row, column = n // columns, n % columns
        for down in range(-1, 2):
            for across in range(-1, 2):
                r, c = row + down, column + across
                if (down == 0 and across == 0) or r < 0 or c < 0 or r >= rows or c >= columns:
                    continue
                m = r * columns + c
                length = cell_m * (1.4142135 if down != 0 and across != 0 else 1.0)
                new = np.float32(key + length * 0.5 * (flat[n] + flat[m]))
                if new < to_go[m]:
                    to_go[m] = new
                    count = heap_push(heap, items, count, float(new), m)
    for n in range(rows * columns):
        if to_go[n] > enough:
            to_go[n] = np.inf
    return to_go.reshape(rows, columns)


class Frame(NamedTuple):
    """Lower left corner of a grid and side of its cells, m."""

    left: float
    bottom: float
    cell: float


class Layers(NamedTuple):
    """What the lattice is planned on.

    Attributes:
        clearance: distance to obstacles, m, `[rows, columns]`.
        unknown: 1 where nothing is known.
        unseen: 1 where a disc of the footprint would cover unknown cells.
        to_go: of `dijkstra`, on coarser cells.
        frame, coarse: of these grids.
    """

    clearance: Floats
    unknown: Floats
    unseen: Floats
    to_go: Floats
    frame: Frame
    coarse: Frame


class LatticeParams(NamedTuple):
    """Numbers of the search, see `PlannerParams`; `min_clearance` is that of the discs, m."""

    step: float
    horizon: float
    min_clearance: float
    inflation_radius: float
    clearance_cost: float
    unknown_cost: float
    unseen_cost: float
    unseen_horizon: float
    curvature_cost: float
    curvature_change_cost: float
    reverse_cost_ratio: float
    direction_change_cost: float
    blind_distance: float
    max_nodes: int


@jit
def cell_value(grid: Floats, x: float, y: float, frame: Frame) -> float:
    """The value of the cell at a place; -1 outside."""
    row, column = int((y - frame.bottom) / frame.cell), int((x - frame.left) / frame.cell)
    if x < frame.left or y < frame.bottom or row >= grid.shape[0] or column >= grid.shape[1]:
        return -1.0
    return float(grid[row, column])


@jit
def footprint_clearance(clearance: Floats, x: float, y: float, heading: float, centers: Floats, frame: Frame) -> float:
    """The least clearance of the discs of the footprint."""
    cos, sin = math.cos(heading), math.sin(heading)
    least = 1e9
    for d in centers:
        least = min(least, cell_value(clearance, x + d * cos, y + d * sin, frame))
    return least


@jit
def covers_unseen(layers: Layers, x: float, y: float, heading: float, direction: float, centers: Floats) -> bool:
    """Whether the leading half of the footprint covers unknown cells."""
    for d in centers:
        at = cell_value(layers.unseen, x + d * math.cos(heading), y + d * math.sin(heading), layers.frame)
        if d * direction > 0 and at > 0:
            return True
    return False


@jit
def lattice_astar(layers: Layers, start: Floats, curvatures: Floats, centers: Floats, p: LatticeParams) -> Floats:
    """The best path for a car that cannot turn on the spot, on a lattice of arcs, over the horizon.

    Args:
        layers: the local map.
        start: x, y, heading, curvature and direction (+1 or -1) of the car.
        curvatures: of the arcs, 1/m.
        centers: of the discs of the footprint, along the body, m.

    Returns:
        `[n, 5]`: x, y, heading, curvature driven to there, direction; the first row is the start. One row: no path.
    """
    frame = layers.frame
    reach = p.horizon + 1.0
    side = int(2 * reach / NODE_M) + 1
    visited = np.full(side * side * HEADINGS * 2, np.inf, np.float32)
    size = p.max_nodes + 16
    node = np.empty((size, 5), np.float32)
    parent = np.empty(size, np.int32)
    cost = np.empty(size, np.float32)
    driven = np.empty(size, np.float32)
    heap, items = np.empty(size, np.float32), np.empty(size, np.int32)
    node[0] = start
    parent[0], cost[0], driven[0] = -1, 0.0, 0.0
    count = heap_push(heap, items, 0, 0.0, 0)
    made, best, best_value = 1, 0, np.inf
    first_clearance = footprint_clearance(layers.clearance, start[0], start[1], start[2], centers, frame)
    end = -1
    while count > 0 and made < p.max_nodes:
        n = items[0]
        count = heap_pop(heap, items, count)
        x, y, heading, curvature, direction = node[n]
        to_go = cell_value(layers.to_go, x, y, layers.coarse)
        if driven[n] > 0.35 and to_go >= 0 and to_go + 0.3 * cost[n] < best_value:
            best, best_value = n, to_go + 0.3 * cost[n]
        if to_go >= 0 and (driven[n] >= p.horizon or to_go < 0.15) and direction > 0:
            end = n
            break
        for backward in range(2):
            to = -1.0 if backward else 1.0
            for bend in curvatures:
                if backward and bend != 0.0 and abs(bend) < 1.9:
                    continue
                # Half of the arc, then all of it.
                turned = bend * p.step * to
                chord = p.step * (math.sin(turned / 2) / (turned / 2) if abs(turned) > 1e-6 else 1.0) * to
                half = p.step / 2 * to
                mx, my = x + half * math.cos(heading + turned / 4), y + half * math.sin(heading + turned / 4)
                nx, ny = x + chord * math.cos(heading + turned / 2), y + chord * math.sin(heading + turned / 2)
                new_heading = heading + turned
                clearance = min(
                    footprint_clearance(layers.clearance, mx, my, heading + turned / 2, centers, frame),
                    footprint_clearance(layers.clearance, nx, ny, new_heading, centers, frame),
                )
                leaves = driven[n] < EXIT_M and clearance >= first_clearance and clearance > 0
                if clearance < p.min_clearance and not leaves:
                    continue
                if backward and cell_value(layers.unknown, nx, ny, frame) > 0:
                    continue
                price = 1.0 + p.curvature_cost * abs(bend)
                if clearance < p.inflation_radius:
                    share = (p.inflation_radius - clearance) / (p.inflation_radius - p.min_clearance)
                    price += p.clearance_cost * share
                nose_x, nose_y = nx + NOSE_M * math.cos(new_heading), ny + NOSE_M * math.sin(new_heading)
                if cell_value(layers.unknown, nose_x, nose_y, frame) > 0:
                    price += p.unknown_cost
                if driven[n] < max(p.unseen_horizon, p.blind_distance):
                    covers = covers_unseen(layers, nx, ny, new_heading, to, centers)
                    if covers and driven[n] + p.step <= p.blind_distance:
                        continue
                    if covers and driven[n] < p.unseen_horizon:
                        price += p.unseen_cost
                if backward:
                    price *= p.reverse_cost_ratio
                g = cost[n] + price * p.step + p.curvature_change_cost * abs(bend - curvature)
                if to != direction:
                    g += p.direction_change_cost
                h = cell_value(layers.to_go, nx, ny, layers.coarse)
                if h < 0 or h == np.inf:
                    continue
                i, j = int((nx - start[0] + reach) / NODE_M), int((ny - start[1] + reach) / NODE_M)
                if i < 0 or j < 0 or i >= side or j >= side:
                    continue
                t = math.floor((new_heading / (2 * math.pi)) * HEADINGS + 0.5) % HEADINGS
                place = ((j * side + i) * HEADINGS + t) * 2 + backward
                if g >= visited[place] - 1e-4 or made >= size:
                    continue
                visited[place] = g
                node[made] = np.array((nx, ny, new_heading, bend, to), np.float32)
                parent[made], cost[made], driven[made] = n, g, driven[n] + p.step
                count = heap_push(heap, items, count, g + h, made)
                made += 1
    n = end if end >= 0 else best
    length, at = 1, n
    while parent[at] >= 0:
        at = parent[at]
        length += 1
    path = np.empty((length, 5), np.float32)
    for m in range(length - 1, -1, -1):
        path[m] = node[n]
        n = parent[n]
    return path
