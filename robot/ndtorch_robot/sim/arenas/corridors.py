"""Four buildings whose walls the seed only moves about: hallway, curve, loop, room."""

from __future__ import annotations

import math

import numpy as np

from ndtorch_robot.sim.arenas.registry import arena
from ndtorch_robot.sim.plan import Plan, circle, ring, square
from ndtorch_robot.sim.shapes import Box, trace

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
