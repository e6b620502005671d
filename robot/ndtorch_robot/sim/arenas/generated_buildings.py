"""Buildings that the seed lays out: an office, and random rooms joined by corridors."""

from __future__ import annotations

import numpy as np

from ndtorch_robot.sim.arenas.registry import arena
from ndtorch_robot.sim.plan import Plan, Ring
from ndtorch_robot.sim.shapes import Box, box_ring, trace


@arena("office")
def office(seed: int) -> Plan:
    """A corridor, 14 x 2 m, with six furnished rooms behind open doors, 14 x 11 m in all."""
    rng = np.random.default_rng((seed, 5))
    rooms = [Box(0.0, -1.0, 14.0, 1.0)]
    solids: list[Ring] = []
    for side in (1, -1):
        for k in range(3):
            left = 0.2 + 4.7 * k
            right = left + float(rng.uniform(3.9, 4.4))
            depth = float(rng.uniform(3.6, 4.4))
            door = float(rng.uniform(left + 0.5, right - 1.7))
            box = Box(left, 1.15, right, 1.15 + depth)
            gap = Box(door, 1.0, door + 1.2, 1.15)
            rooms += [mirrored(box, side), mirrored(gap, side)]
            solids += [box_ring(mirrored(b, side), 0.75) for b in furniture(box, gap, rng)]
    outline, inner = trace(rooms)
    return Plan("office", outline, (*inner, *solids), (0.6, 0.0, 0.0))


def mirrored(box: Box, side: int) -> Box:
    return box if side > 0 else Box(box.left, -box.top, box.right, -box.bottom, box.kind)


def furniture(room: Box, gap: Box, rng: np.random.Generator) -> list[Box]:
    """A desk at the wall opposite the door, a cupboard at a side wall."""
    width, depth = float(rng.uniform(1.2, 1.8)), float(rng.uniform(0.6, 0.8))
    x = float(rng.uniform(room.left + 0.01, room.right - width - 0.01))
    boxes = [Box(x, room.top - depth - 0.01, x + width, room.top - 0.01)]
    deep, long = 0.4, float(rng.uniform(0.8, 1.2))
    # On the side that is farther from the door, so that nobody bumps into it on entering.
    at_left = gap.left - room.left > room.right - gap.right
    x = room.left + 0.01 if at_left else room.right - deep - 0.01
    y = float(rng.uniform(room.bottom + 0.3, room.bottom + 1.0))
    boxes.append(Box(x, y, x + deep, y + long))
    return boxes


@arena("random")
def random_building(seed: int) -> Plan:
    """Rooms on a 4 x 3 grid, joined by a random tree of corridors and a few more; pillars in the large ones."""
    rng = np.random.default_rng((seed, 6))
    pitch, columns, rows = 3.8, 4, 3
    cells = [(i, j) for i in range(columns) for j in range(rows)]
    joined = {cells[int(rng.integers(len(cells)))]}
    links: list[tuple[tuple[int, int], tuple[int, int]]] = []
    wanted = int(rng.integers(8, len(cells) + 1))
    while len(joined) < wanted:
        choices = [(a, b) for a in sorted(joined) for b in beside(a, columns, rows) if b not in joined]
        a, b = choices[int(rng.integers(len(choices)))]
        joined.add(b)
        links.append((a, b))
    for a in sorted(joined):
        links += [(a, b) for b in beside(a, columns, rows) if b in joined and a < b and rng.random() < 0.25]
    boxes, holes = [], []
    for i, j in sorted(joined):
        wide, high = (round(float(v), 2) for v in rng.uniform(1.1, 1.75, 2))
        boxes.append(Box(i * pitch - wide, j * pitch - high, i * pitch + wide, j * pitch + high))
        if min(wide, high) > 1.45:
            size = float(rng.uniform(0.15, 0.25))
            x, y = i * pitch + float(rng.uniform(-0.2, 0.2)), j * pitch + float(rng.uniform(-0.2, 0.2))
            holes.append(Box(x - size, y - size, x + size, y + size, "pillar"))
    for (ai, aj), (bi, bj) in links:
        half = round(float(rng.uniform(0.8, 1.05)), 2)
        low, high_ = (min(ai, bi) * pitch, min(aj, bj) * pitch), (max(ai, bi) * pitch, max(aj, bj) * pitch)
        across = (0.0, half) if aj == bj else (half, 0.0)
        boxes.append(Box(low[0] - across[0], low[1] - across[1], high_[0] + across[0], high_[1] + across[1]))
    outline, solids = trace(boxes, holes)
    return Plan("random", outline, solids)


def beside(cell: tuple[int, int], columns: int, rows: int) -> list[tuple[int, int]]:
    i, j = cell
    around = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
    return [(a, b) for a, b in around if 0 <= a < columns and 0 <= b < rows]
