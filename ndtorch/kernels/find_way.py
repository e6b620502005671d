"""A way for a car that cannot turn on the spot, on a lattice of arcs."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.kernels.ways import Floats, look, pop, push, room
from ndtorch.utils.jit import jit

HEADINGS = 24
"""Headings that the lattice tells apart."""


@jit
def find_way(
    clear: Floats,
    unknown: Floats,
    hidden: Floats,
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
    hidden_price: float,
    seen_soon: float,
    bend_price: float,
    swing_price: float,
    reverse_price: float,
    switch_price: float,
    blind: float,
    most: int,
) -> Floats:
    """The best way on a lattice of arcs (A*), from a pose to where `horizon` metres are driven.

    Args:
        clear: distance to what is blocked, m, `[R, C]`; unknown: 1 where nothing is known.
        hidden: 1 where a disc of the body would cover what was not seen.
        heuristic: `cost_to_go` on cells of `coarse` metres, with the same lower left corner.
        start: x, y, heading, curvature and direction (+1 or -1) now.
        bends: curvatures of the arcs, 1/m.
        discs: middles of the discs that stand for the body, along it, m.
        step: length of an arc, m.
        hard, soft: the discs keep `hard` metres away, and nearer than `soft` costs up to `tight_price` a metre more.
        unknown_price, bend_price: of a metre more, and of a unit of curvature a metre.
        hidden_price: of a metre in which the leading half of the body covers what was not seen, in the first
            `seen_soon` metres; farther on it will have been seen.
        swing_price: of a change of the curvature by one unit.
        reverse_price, switch_price: of a metre backward, and of changing the direction.
        blind: in the first so many metres the leading half of the body covers nothing that was not seen.
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
                if driven[n] < max(seen_soon, blind):
                    covers = False
                    for d in discs:
                        at = look(hidden, nx + d * math.cos(nth), ny + d * math.sin(nth), left, bottom, cell)
                        if d * to > 0 and at > 0:
                            covers = True
                            break
                    if covers and driven[n] + step <= blind:
                        continue
                    if covers and driven[n] < seen_soon:
                        price += hidden_price
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
