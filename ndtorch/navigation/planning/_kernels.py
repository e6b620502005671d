"""Kernels of planning: Dijkstra on a costmap, and A* on a lattice of arcs."""

from __future__ import annotations

import heapq
import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float32]

STEP_M, HEADINGS, NODE_M = 0.2, 24, 0.1
"""Length of the arcs of the lattice, number of its headings, and side of the squares in which nodes are the same."""

MAX_NODES = 12000
"""A search makes no more nodes than this."""

EXIT_M = 0.5
"""A car that is too near to an obstacle may leave within this distance, but not go nearer."""

NOSE_M = 0.25
"""Unknown cells are looked for this far ahead of the body's origin."""

HORIZON_M, INFLATION_RADIUS_M = 2.6, 0.45
"""Length of a path, and clearance of the middle line of the body from which on it costs nothing more."""

CLEARANCE_COST, REVERSE_COST_RATIO = 1.5, 2.5
"""Metres more for a metre at the least clearance, and cost of driving backward over that of driving ahead."""

UNKNOWN_COST, CURVATURE_COST, CURVATURE_CHANGE_COST, DIRECTION_CHANGE_COST = 0.3, 0.05, 0.05, 0.8
"""Metres more for a metre into unknown cells, for each unit of curvature of a metre, for a change of the curvature by
one unit, and for a change between forward and backward."""


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
    to_go, flat = goal.copy().ravel(), cost.ravel()
    heap = [(to_go[n], n) for n in range(rows * columns) if to_go[n] < np.inf]
    heapq.heapify(heap)
    enough = np.inf
    while len(heap) > 0:
        key, n = heapq.heappop(heap)
        if key > to_go[n]:
            continue
        if key > enough:
            break
        if n == start:
            enough = key + beyond
        row, column = n // columns, n % columns
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                m = r * columns + c
                length = cell_m * (math.sqrt(2.0) if r != row and c != column else 1.0)
                new = np.float32(key + length * 0.5 * (flat[n] + flat[m]))
                if new < to_go[m]:
                    to_go[m] = new
                    heapq.heappush(heap, (new, m))
    return np.where(to_go > enough, np.float32(np.inf), to_go).reshape(rows, columns)


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
        to_go: of `dijkstra`, on coarser cells.
        frame, coarse: of these grids.
    """

    clearance: Floats
    unknown: Floats
    to_go: Floats
    frame: Frame
    coarse: Frame


@jit
def cell_value(grid: Floats, x: float, y: float, frame: Frame) -> float:
    """The value of the cell that holds a point; -1 outside."""
    row, column = math.floor((y - frame.bottom) / frame.cell), math.floor((x - frame.left) / frame.cell)
    inside = 0 <= row < grid.shape[0] and 0 <= column < grid.shape[1]
    return float(grid[row, column]) if inside else -1.0


@jit
def footprint_clearance(clearance: Floats, x: float, y: float, heading: float, centers: Floats, frame: Frame) -> float:
    """The least clearance of the discs of the footprint."""
    cos, sin, least = math.cos(heading), math.sin(heading), 1e9
    for d in centers:
        least = min(least, cell_value(clearance, x + d * cos, y + d * sin, frame))
    return least


@jit
def lattice_astar(layers: Layers, start: Floats, curvatures: Floats, centers: Floats, min_clearance: float) -> Floats:
    """The best path for a car that cannot turn on the spot, on a lattice of arcs, over the horizon.

    Args:
        layers: the local map.
        start: x, y, heading, curvature and direction (+1 or -1) of the car.
        curvatures: of the arcs, 1/m; backward the straight and the tightest ones are driven.
        centers: of the discs of the footprint, along the body, m.
        min_clearance: of the discs, m.

    Returns:
        `[n, 5]`: x, y, heading, curvature driven to there, direction; the first row is the start. One row: no path.
    """
    frame, tightest, reach = layers.frame, np.abs(curvatures).max(), HORIZON_M + 1.0
    side = int(2 * reach / NODE_M) + 1
    visited = np.full((side, side, HEADINGS, 2), np.inf, np.float32)
    node, parent = np.empty((MAX_NODES, 5), np.float32), np.empty(MAX_NODES, np.int64)
    cost, driven = np.zeros(MAX_NODES, np.float32), np.zeros(MAX_NODES, np.float32)
    node[0], parent[0] = start, -1
    heap, made, end, best, best_value = [(np.float32(0.0), 0)], 1, -1, 0, np.inf
    first_clearance = footprint_clearance(layers.clearance, start[0], start[1], start[2], centers, frame)
    while len(heap) > 0 and made < MAX_NODES:
        _, n = heapq.heappop(heap)
        x, y, heading, curvature, direction = node[n]
        to_go = cell_value(layers.to_go, x, y, layers.coarse)
        if driven[n] > 0.35 and to_go >= 0 and to_go + 0.3 * cost[n] < best_value:
            best, best_value = n, to_go + 0.3 * cost[n]
        if to_go >= 0 and (driven[n] >= HORIZON_M or to_go < 0.15) and direction > 0:
            end = n
            break
        for backward in range(2):
            to = -1.0 if backward else 1.0
            for bend in curvatures:
                if backward and 0.0 < abs(bend) < 0.99 * tightest:
                    continue
                turned, new_heading = bend * STEP_M * to, heading + bend * STEP_M * to
                chord = STEP_M * (math.sin(turned / 2) / (turned / 2) if abs(turned) > 1e-6 else 1.0) * to
                half = STEP_M / 2 * to
                mx, my = x + half * math.cos(heading + turned / 4), y + half * math.sin(heading + turned / 4)
                nx, ny = x + chord * math.cos(heading + turned / 2), y + chord * math.sin(heading + turned / 2)
                clearance = min(
                    footprint_clearance(layers.clearance, mx, my, heading + turned / 2, centers, frame),
                    footprint_clearance(layers.clearance, nx, ny, new_heading, centers, frame),
                )
                leaves = driven[n] < EXIT_M and clearance >= first_clearance and clearance > 0
                if clearance < min_clearance and not leaves:
                    continue
                if backward and cell_value(layers.unknown, nx, ny, frame) > 0:
                    continue
                h = cell_value(layers.to_go, nx, ny, layers.coarse)
                if h < 0 or h == np.inf:
                    continue
                lack = (INFLATION_RADIUS_M - clearance) / (INFLATION_RADIUS_M - min_clearance)
                price = 1.0 + CURVATURE_COST * abs(bend) + CLEARANCE_COST * max(lack, 0.0)
                nose_x, nose_y = nx + NOSE_M * math.cos(new_heading), ny + NOSE_M * math.sin(new_heading)
                if cell_value(layers.unknown, nose_x, nose_y, frame) > 0:
                    price += UNKNOWN_COST
                if backward:
                    price *= REVERSE_COST_RATIO
                g = cost[n] + price * STEP_M + CURVATURE_CHANGE_COST * abs(bend - curvature)
                if to != direction:
                    g += DIRECTION_CHANGE_COST
                i, j = int((nx - start[0] + reach) / NODE_M), int((ny - start[1] + reach) / NODE_M)
                if not (0 <= i < side and 0 <= j < side):
                    continue
                t = math.floor((new_heading / (2 * math.pi)) * HEADINGS + 0.5) % HEADINGS
                if g >= visited[j, i, t, backward] - 1e-4 or made >= MAX_NODES:
                    continue
                visited[j, i, t, backward] = g
                node[made] = np.array((nx, ny, new_heading, bend, to), np.float32)
                parent[made], cost[made], driven[made] = n, g, driven[n] + STEP_M
                heapq.heappush(heap, (np.float32(g + h), made))
                made += 1
    n = end if end >= 0 else best
    chain = [n]
    while parent[n] >= 0:
        n = parent[n]
        chain.append(n)
    path: Floats = node[np.array(chain[::-1])]
    return path
