"""Arenas from TOML files.

name = "lab"
rooms = [[0, 0, 8, 6], [8, 2, 14, 4]]          # left, bottom, right, top in m; or
walls = [[0, 0, 8, 0], [8, 0, 8, 6], ...]      # from x, y to x, y, each beginning where the last ended
blank_walls = [1]                              # numbers of walls without texture, from 0
pillars = [{x = 4, y = 3, width = 0.4, round = true}]
start = [1, 1, 90]                             # x, y in m, heading in degrees
height = 2.4
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from pydantic import Field

from ndtorch.errors import InputError
from ndtorch.toml import Strict, read_toml
from ndtorch_robot.sim.places import Places
from ndtorch_robot.sim.plan import NARROWEST, Plan, Ring, circle, ring, square
from ndtorch_robot.sim.tracing import Box, trace

Four = tuple[float, float, float, float]


class Pillar(Strict):
    """A pillar: its middle and its width, m."""

    x: float
    y: float
    width: Annotated[float, Field(ge=0.02, le=5.0)]
    round: bool = False


class ArenaFile(Strict):
    """What a file may say."""

    name: str
    rooms: tuple[Four, ...] = ()
    walls: tuple[Four, ...] = ()
    blank_walls: tuple[int, ...] = ()
    pillars: tuple[Pillar, ...] = ()
    start: tuple[float, float, float] | None = None
    height: float = 2.4


def read_arena(path: Path) -> Plan:
    """The plan in a file.

    Raises:
        InputError: in one line, what is wrong with it: an unknown key, a gap in the walls, a passage too
            narrow for the car.
    """
    file = read_toml(path, ArenaFile)
    if bool(file.rooms) == bool(file.walls):
        raise InputError(f"{path}: give either rooms or walls")
    try:
        if file.rooms:
            outline, inner = trace([room_box(room) for room in file.rooms])
        else:
            outline, inner = outline_of(file.walls, set(file.blank_walls)), ()
        solids = tuple(pillar_ring(p) for p in file.pillars)
        start = (*file.start[:2], math.radians(file.start[2])) if file.start else None
        plan = Plan(file.name, outline, (*inner, *solids), start, height=file.height)
        Places(plan)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return plan


def room_box(room: Four) -> Box:
    """A rectangle of the file as a box."""
    box = Box(*room)
    if min(box.right - box.left, box.top - box.bottom) < NARROWEST:
        raise InputError(f"room {list(room)} must be left, bottom, right, top and at least {NARROWEST} m wide")
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
    """A pillar as a polygon."""
    if pillar.round:
        return ring(circle(pillar.x, pillar.y, pillar.width / 2, 16), "pillar", solid=True)
    return ring(square(pillar.x, pillar.y, pillar.width, math.pi / 4), "pillar", solid=True)
