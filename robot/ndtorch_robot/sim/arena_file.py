"""Arenas from TOML files.

name = "lab"
rooms = [[0, 0, 8, 6], [8.1, 2, 14, 4]]        # left, bottom, right, top in m; or
walls = [[0, 0, 8, 0], [8, 0, 8, 6], ...]      # from x, y to x, y, each beginning where the last ended
blank_walls = [1]                              # numbers of walls without texture, from 0
doors = [[8, 2.4, 8.1, 3.2]]                   # rectangles that join rooms through thin walls
pillars = [{x = 4, y = 3, width = 0.4, round = true, height = 1.2}]
boxes = [{at = [2, 2, 4, 3], bottom = 0.12, height = 0.75}]    # low boxes, overhangs, sills
tables = [{at = [5, 1, 6.2, 1.7], height = 0.72, legs = 0.04}]
floor = "tiles"                                # carpet, tiles, checker, smooth, lines
floor_size = 0.3
lamps = [{x = 3, y = 3, radius = 0.5, gain = 0.8}]
start = [1, 1, 90]                             # x, y in m, heading in degrees
height = 2.4
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from ndtorch.errors import InputError
from ndtorch.utils.toml import Strict, read_toml
from ndtorch_robot.sim.floors import Floor, Lamp, Pattern
from ndtorch_robot.sim.plan import NARROWEST, Plan, Ring, circle, cylinder, narrow_gaps, ring, square
from ndtorch_robot.sim.shapes import Box, box_ring, table_rings, trace
from ndtorch_robot.sim.spawn_points import SpawnPoints

CAR_WIDTH = 0.36
"""Metres."""

Four = tuple[float, float, float, float]


class Pillar(Strict):
    """A pillar: its middle and its width, m."""

    x: float
    y: float
    width: Annotated[float, Field(ge=0.02, le=5.0)]
    round: bool = False
    height: Annotated[float, Field(gt=0.02, le=10.0)] | None = None


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


class LampTable(Strict):
    """A pool of light on the floor; see `ndtorch_robot.sim.floors.Lamp`."""

    x: float
    y: float
    radius: Annotated[float, Field(gt=0, le=10)]
    gain: Annotated[float, Field(ge=-1, le=3)]


class ArenaFile(Strict):
    """What a file may say."""

    name: str
    rooms: tuple[Four, ...] = ()
    walls: tuple[Four, ...] = ()
    blank_walls: tuple[int, ...] = ()
    doors: tuple[Four, ...] = ()
    pillars: tuple[Pillar, ...] = ()
    boxes: tuple[BoxTable, ...] = ()
    tables: tuple[TableTable, ...] = ()
    floor: Pattern = "carpet"
    floor_size: Annotated[float, Field(ge=0)] = 0.0
    lamps: tuple[LampTable, ...] = ()
    start: tuple[float, float, float] | None = None
    height: float = 2.4

    @model_validator(mode="before")
    @classmethod
    def flat(cls, values: Any) -> Any:
        if isinstance(values, dict) and "ramps" in values:
            raise InputError("ramps cannot be built: the simulated car stays level; a box up to 2 cm high is a sill")
        return values


def read_arena(path: Path) -> Plan:
    """The plan in a file."""
    file = read_toml(path, ArenaFile)
    if bool(file.rooms) == bool(file.walls):
        raise InputError(f"{path}: give either rooms or walls")
    if file.rooms and file.blank_walls:
        raise InputError(f"{path}: blank_walls are numbers of walls, and this file gives rooms")
    if file.walls and file.doors:
        raise InputError(f"{path}: doors join rooms, and this file gives walls")
    try:
        if file.rooms:
            outline, inner = trace([*map(room_box, file.rooms), *map(door_box, file.doors)])
        else:
            outline, inner = outline_of(file.walls, set(file.blank_walls)), ()
        solids = [pillar_ring(p) for p in file.pillars]
        solids += [box_ring(checked(box.at), box.height, box.bottom) for box in file.boxes]
        for table in file.tables:
            solids += table_rings(checked(table.at), table.height, table.legs)
        floor = Floor(file.floor, file.floor_size, lamps=tuple(Lamp(**vars(lamp)) for lamp in file.lamps))
        start = (*file.start[:2], math.radians(file.start[2])) if file.start else None
        plan = Plan(file.name, outline, (*inner, *solids), start, height=file.height, floor=floor)
        SpawnPoints(plan)
        plan = replace(plan, remarks=narrow_gaps(plan))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return plan


def room_box(room: Four) -> Box:
    box = Box(*room)
    if min(box.right - box.left, box.top - box.bottom) < NARROWEST - 1e-6:
        raise InputError(f"room {list(room)} must be left, bottom, right, top and at least {NARROWEST} m wide")
    return box


def door_box(door: Four) -> Box:
    """A passage of the file as a box: one side may be as thin as a wall."""
    box = checked(door)
    if max(box.right - box.left, box.top - box.bottom) < CAR_WIDTH:
        raise InputError(f"door {list(door)} is narrower than the car ({CAR_WIDTH} m)")
    return box._replace(kind="jamb")


def checked(at: Four) -> Box:
    box = Box(*at)
    if not (box.right > box.left and box.top > box.bottom):
        raise InputError(f"{list(at)} must be left, bottom, right, top")
    return box


def outline_of(walls: tuple[Four, ...], blank: set[int]) -> Ring:
    """The ring that the walls make, which must close."""
    if len(walls) < 3:
        raise InputError(f"three walls or more are needed, got {len(walls)}")
    for k, (wall, after) in enumerate(zip(walls, walls[1:] + walls[:1], strict=True)):
        gap = math.dist(wall[2:], after[:2])
        if gap > 1e-3:
            raise InputError(
                f"the walls leave a gap of {gap:.2f} m between {wall[2:]}, the end of wall {k}, "
                f"and {after[:2]}, the beginning of wall {(k + 1) % len(walls)}"
            )
    if not blank <= set(range(len(walls))):
        raise InputError(f"blank_walls must be numbers of walls, 0 to {len(walls) - 1}, got {sorted(blank)}")
    made = Ring(
        tuple((x, y) for x, y, _, _ in walls), tuple("blank" if k in blank else "wall" for k in range(len(walls)))
    )
    return made if made.area > 0 else made.flipped()


def pillar_ring(pillar: Pillar) -> Ring:
    if pillar.round and pillar.height is not None:
        return cylinder(pillar.x, pillar.y, pillar.width / 2, pillar.height, 12)
    if pillar.round:
        return ring(circle(pillar.x, pillar.y, pillar.width / 2, 16), "pillar", solid=True)
    return ring(square(pillar.x, pillar.y, pillar.width, math.pi / 4), "pillar", pillar.height, solid=True)
