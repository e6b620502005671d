"""Arenas in which no controller was developed: floors, thin and low obstacles, narrow places."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ndtorch_robot.sim.arenas.buildings import hallway, loop
from ndtorch_robot.sim.arenas.registry import arena
from ndtorch_robot.sim.floors import Floor
from ndtorch_robot.sim.plan import Plan, Point, cylinder
from ndtorch_robot.sim.shapes import Box, box_ring, chair_rings, table_rings, trace

POLE = 0.025
"""Radius of the poles of the slalom, m."""

THIN = 0.08
"""Depth of the walls with doors, m."""


@arena("tiles", test=True)
def tiles(seed: int) -> Plan:
    """The loop with a floor of tiles, 30 cm, with dark joints of 6 mm."""
    return replace(loop(seed), name="tiles", floor=Floor("tiles"))


@arena("checker", test=True)
def checker(seed: int) -> Plan:
    """The loop with a floor of light and dark checks, 25 cm."""
    return replace(loop(seed), name="checker", floor=Floor("checker"))


@arena("smooth", test=True)
def smooth(seed: int) -> Plan:
    """The loop with a floor almost without texture."""
    return replace(loop(seed), name="smooth", floor=Floor("smooth"))


@arena("lines", test=True)
def lines(seed: int) -> Plan:
    """The hallway with dark lines, 3 cm wide, across its floor every 2.5 m."""
    plan = hallway(seed)
    _, right, bottom, top = plan.bounds
    gates = tuple(((x, bottom), (x, top)) for x in np.arange(2.5, right - 0.6, 2.5).tolist())
    return replace(plan, name="lines", floor=Floor("lines"), gates=gates)


@arena("chairs", test=True)
def chairs(seed: int) -> Plan:
    """A room of 7 x 7 m with five chairs and a table, on legs 3 cm wide."""
    rng = np.random.default_rng((seed, 10))
    side = 7.0
    outline, _ = trace([Box(0, 0, side, side)])
    places = scattered(rng, 6, 1.3, side - 1.3, 1.7)
    solids = [part for x, y in places[:5] for part in chair_rings(x, y, float(rng.uniform(0, math.pi / 2)))]
    x, y = places[5]
    solids += table_rings(Box(x - 0.6, y - 0.35, x + 0.6, y + 0.35), 0.72)
    return Plan("chairs", outline, tuple(solids))


@arena("slalom", test=True)
def slalom(seed: int) -> Plan:
    """A hall of 12 x 3 m with poles 5 cm wide, left and right in turn."""
    rng = np.random.default_rng((seed, 11))
    outline, _ = trace([Box(0, 0, 12.0, 3.0)])
    xs = 2.2 + 1.3 * np.arange(7)
    ys = 1.5 + np.where(np.arange(7) % 2, 0.4, -0.4) + rng.uniform(-0.15, 0.15, 7)
    poles = tuple(cylinder(float(x), float(y), POLE, 1.2, 8) for x, y in zip(xs, ys, strict=True))
    return Plan("slalom", outline, poles, (0.6, 1.5, 0.0))


@arena("sofa", test=True)
def sofa(seed: int) -> Plan:
    """A room of 6 x 5 m with two sofas that have 12 cm of air below them."""
    rng = np.random.default_rng((seed, 12))
    outline, _ = trace([Box(0, 0, 6.0, 5.0)])
    x, y = float(rng.uniform(1.5, 2.5)), float(rng.uniform(2.0, 2.4))
    free = box_ring(Box(x, y, x + 1.9, y + 0.85), 0.75, 0.12)
    at = float(rng.uniform(0.8, 3.2))
    at_wall = box_ring(Box(at, 0.01, at + 1.9, 0.86), 0.75, 0.12)
    return Plan("sofa", outline, (free, at_wall))


@arena("dead-end", test=True)
def dead_end(seed: int) -> Plan:
    """A corridor 1.0 m wide that ends after 3.5 m; the car starts in it, its back to a room of 4 x 4 m."""
    rng = np.random.default_rng((seed, 13))
    y = float(rng.uniform(0.6, 2.4))
    outline, solids = trace([Box(0, 0, 4.0, 4.0), Box(4.0, y, 7.5, y + 1.0)])
    gate = ((4.0, y), (4.0, y + 1.0))
    return Plan("dead-end", outline, solids, (4.6, y + 0.5, 0.0), gates=(gate,))


@arena("door-61", test=True)
def door_61(seed: int) -> Plan:
    """Two rooms of 4 x 4 m with a thin wall between and a door of 0.61 m in it."""
    return doorway(seed, "door-61", 0.61)


@arena("door-81", test=True)
def door_81(seed: int) -> Plan:
    """Two rooms of 4 x 4 m with a thin wall between and a door of 0.81 m in it."""
    return doorway(seed, "door-81", 0.81)


def doorway(seed: int, name: str, wide: float) -> Plan:
    rng = np.random.default_rng((seed, 14))
    y = float(rng.uniform(0.8, 3.2 - wide))
    rooms = [Box(0, 0, 4.0, 4.0), Box(4.0 + THIN, 0, 8.0 + THIN, 4.0), Box(4.0, y, 4.0 + THIN, y + wide, "jamb")]
    outline, solids = trace(rooms)
    start = (float(rng.uniform(1.0, 1.6)), float(rng.uniform(1.2, 2.8)), 0.0)
    middle = 4.0 + THIN / 2
    return Plan(name, outline, solids, start, gates=(((middle, y), (middle, y + wide)),))


@arena("t-junction", test=True)
def t_junction(seed: int) -> Plan:
    """A corridor of 10 x 1.6 m with a stem of the same width and 5 m length in the middle of one side."""
    rng = np.random.default_rng((seed, 15))
    wide, x = 1.6, float(rng.uniform(3.6, 4.8))
    outline, solids = trace([Box(0, 0, 10.0, wide), Box(x, wide, x + wide, wide + 5.0)])
    y = wide + 0.8
    return Plan("t-junction", outline, solids, (0.8, wide / 2, 0.0), gates=(((x, y), (x + wide, y)),))


def scattered(rng: np.random.Generator, count: int, low: float, high: float, least: float) -> list[Point]:
    """Places in a square, at least so far from each other; fewer far ones where they do not fit."""
    found: list[Point] = []
    tries = 0
    while len(found) < count:
        x, y = (float(v) for v in rng.uniform(low, high, 2))
        tries += 1
        if all(math.dist((x, y), other) > least * 0.98 ** (tries // 50) for other in found):
            found.append((x, y))
    return found
