"""Buildings: hallway, curve, loop and room, whose walls the seed moves about; office and random, which it lays out."""

from __future__ import annotations

import math

import numpy as np

from ndtorch_robot.sim.arenas.registry import arena
from ndtorch_robot.sim.plan import Plan, Ring, circle, ring, square
from ndtorch_robot.sim.shapes import Box, box_ring, trace

DOOR_SPACING = 1.308
"""Metres between neighbouring doors, as measured in the hallway of [A §2.3]."""

DOOR_WIDTH, NICHE = 0.91, 0.10


@arena("hallway")
def hallway(seed: int) -> Plan:
    """A straight hallway, 18 x 2 m: niches with doors 1.308 m apart on both sides, pillars, end walls."""
    rng = np.random.default_rng((seed, 1))
    half, length = 1.0, 18.0
    rooms, holes, doors = [Box(0.0, -half, length, half)], [], []
    for side in (1, -1):
        first = float(rng.uniform(1.2, 1.9))
        for group in range(3):
            row = []
            begin = first + group * 5.2
            for k in range(3):
                x = begin + k * DOOR_SPACING
                niche = (half, half + NICHE) if side > 0 else (-half - NICHE, -half)
                rooms.append(Box(x, niche[0], x + DOOR_WIDTH, niche[1], "door"))
                row.append((x, side * half))
            doors.append(tuple(row))
            doors.append(tuple((x + DOOR_WIDTH, y) for x, y in row))
            post = begin + 3 * DOOR_SPACING + 0.25
            if post + 0.3 < length - 0.5:
                reach = (half - 0.12, half) if side > 0 else (-half, -half + 0.12)
                holes.append(Box(post, reach[0], post + 0.3, reach[1], "pillar"))
    outline, solids = trace(rooms, holes)
    start = (0.5, float(rng.uniform(-0.1, 0.1)), 0.0)
    return Plan("hallway", outline, solids, start, tuple(doors), DOOR_SPACING)


@arena("curve")
def curve(seed: int) -> Plan:
    """A hallway bent into a ring: outer radius 12 m, width 2.4 m."""
    rng = np.random.default_rng((seed, 2))
    outer, inner = 12.0, 9.6
    angle = float(rng.uniform(0, 2 * math.pi))
    middle = (outer + inner) / 2
    start = (middle * math.cos(angle), middle * math.sin(angle), angle + math.pi / 2)
    walls = ring(circle(0, 0, outer, 120))
    core = ring(circle(0, 0, inner, 120), solid=True)
    return Plan("curve", walls, (core,), start)


@arena("loop")
def loop(seed: int) -> Plan:
    """A corridor around a block: 13 x 10 m outside, 2.2 m wide, with some doors and a few pillars."""
    rng = np.random.default_rng((seed, 3))
    width, height, wide = 13.0, 10.0, 2.2
    rooms = [Box(0, 0, width, height)]
    for k in range(3):
        x = 2.0 + 3.2 * k + float(rng.uniform(-0.4, 0.4))
        rooms.append(Box(x, -NICHE, x + DOOR_WIDTH, 0, "door"))
        x = 2.0 + 3.2 * k + float(rng.uniform(-0.4, 0.4))
        rooms.append(Box(x, height, x + DOOR_WIDTH, height + NICHE, "door"))
    holes = [Box(wide, wide, width - wide, height - wide)]
    y = float(rng.uniform(3.5, 5.5))
    holes.append(Box(width - 0.15, y, width, y + 0.4, "pillar"))
    outline, solids = trace(rooms, holes)
    return Plan("loop", outline, solids, (float(rng.uniform(2.5, 5.0)), wide / 2, 0.0))


@arena("room")
def room(seed: int) -> Plan:
    """A room of 8 x 8 m with two doors and five pillars, round and square."""
    rng = np.random.default_rng((seed, 4))
    side = 8.0
    x, y = (float(v) for v in rng.uniform(1.5, 5.5, 2))
    rooms = [Box(0, 0, side, side), Box(x, side, x + DOOR_WIDTH, side + NICHE, "door")]
    rooms.append(Box(side, y, side + NICHE, y + DOOR_WIDTH, "door"))
    outline, _ = trace(rooms)
    pillars: list[tuple[float, float]] = []
    while len(pillars) < 5:
        place = tuple(float(v) for v in rng.uniform(1.6, side - 1.6, 2))
        if all(math.dist(place, other) > 2.0 for other in pillars):
            pillars.append((place[0], place[1]))
    solids = tuple(
        ring(circle(*p, float(rng.uniform(0.15, 0.3)), 16), "pillar", solid=True)
        if k % 2
        else ring(square(*p, float(rng.uniform(0.3, 0.5)), float(rng.uniform(0, 1.57))), "pillar", solid=True)
        for k, p in enumerate(pillars)
    )
    return Plan("room", outline, solids)


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
