"""Arenas from TOML files.

name = "lab"
rooms = [[0, 0, 8, 6], [8.1, 2, 14, 4]]        # left, bottom, right, top in m
doors = [[8, 2.4, 8.1, 3.2]]                   # rectangles that join rooms through thin walls
pillars = [{x = 4, y = 3, width = 0.4, round = true, height = 1.2}]
boxes = [{at = [2, 2, 4, 3], bottom = 0.12, height = 0.75}]    # low boxes, overhangs, sills
tables = [{at = [5, 1, 6.2, 1.7], height = 0.72, legs = 0.04}]
floor = "tiles"                                # carpet, tiles, checker, smooth, lines
floor_size = 0.3
start = [1, 1, 90]                             # x, y in m, heading in degrees
height = 2.4
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict, read_toml
from ndtorch_robot.sim.plan import Plan, Ring, circle, cylinder, ring
from ndtorch_robot.sim.shapes import Box, box_ring, table_rings, trace
from ndtorch_robot.sim.spawn_points import SpawnPoints
from ndtorch_robot.sim.textures import Floor, Pattern

CAR_WIDTH, NARROWEST = 0.36, 0.6
"""Metres: a passage narrower than the second leaves the car no room to steer."""

Four = tuple[float, float, float, float]


class Pillar(Strict):
    """A pillar: its middle and its width, m."""

    x: float
    y: float
    width: Annotated[float, Field(ge=0.02, le=5.0)]
    round: bool = False
    height: Annotated[float, Field(gt=0.02, le=10.0)] | None = None

    def ring(self) -> Ring:
        if self.round and self.height is not None:
            return cylinder(self.x, self.y, self.width / 2, self.height, 12)
        if self.round:
            return ring(circle(self.x, self.y, self.width / 2, 16), "pillar", solid=True)
        corners = circle(self.x, self.y, self.width / math.sqrt(2), 4, math.pi / 4)
        return ring(corners, "pillar", self.height, solid=True)


class BoxTable(Strict):
    """A box: its rectangle, and from where up to where it reaches, m. A sill, up to 2 cm high, is driven over."""

    at: Four
    bottom: Annotated[float, Field(ge=0, le=10)] = 0.0
    height: Annotated[float, Field(gt=0, le=10)]


class TableTable(Strict):
    """A table: the rectangle of its top, how high that is, and how wide the four legs are, m."""

    at: Four
    height: Annotated[float, Field(gt=0.3, le=2)] = 0.72
    legs: Annotated[float, Field(ge=0.02, le=0.3)] = 0.04


class ArenaFile(Strict):
    """The keys of a file."""

    name: str
    rooms: Annotated[tuple[Four, ...], Field(min_length=1)]
    doors: tuple[Four, ...] = ()
    pillars: tuple[Pillar, ...] = ()
    boxes: tuple[BoxTable, ...] = ()
    tables: tuple[TableTable, ...] = ()
    floor: Pattern = "carpet"
    floor_size: Annotated[float, Field(ge=0)] = 0.0
    start: tuple[float, float, float] | None = None
    height: float = 2.4


def read_arena(path: Path) -> Plan:
    """The plan in a file."""
    file = read_toml(path, ArenaFile)
    try:
        rooms = [rectangle(room, NARROWEST, NARROWEST) for room in file.rooms]
        doors = [rectangle(door, CAR_WIDTH)._replace(kind="jamb") for door in file.doors]
        outline, inner = trace(rooms + doors)
        solids = [pillar.ring() for pillar in file.pillars]
        solids += [box_ring(rectangle(box.at), box.height, box.bottom) for box in file.boxes]
        solids += [part for t in file.tables for part in table_rings(rectangle(t.at), t.height, t.legs)]
        start = (*file.start[:2], math.radians(file.start[2])) if file.start else None
        floor = Floor(file.floor, file.floor_size)
        plan = Plan(file.name, outline, (*inner, *solids), start, height=file.height, floor=floor)
        SpawnPoints(plan)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return plan


def rectangle(at: Four, longest: float = 0.0, shortest: float = 0.0) -> Box:
    """A rectangle of a file, whose sides are at least so long."""
    box = Box(*at)
    sides = box.right - box.left, box.top - box.bottom
    if min(sides) <= 0 or max(sides) < longest - 1e-6 or min(sides) < shortest - 1e-6:
        least = f" and at least {longest} m wide" if longest else ""
        raise InputError(f"{list(at)} must be left, bottom, right, top{least}")
    return box
