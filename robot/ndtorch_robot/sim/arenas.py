"""Arenas: functions from a seed to a plan.

The seed moves the walls of hallway, curve, loop and room about, and lays out office. No controller was
developed in the others: floors, thin and low obstacles, narrow places. Those with one layout are files.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, NamedTuple, cast

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ndtorch.errors import InputError, did_you_mean
from ndtorch.navigation.stereo.calibration_files import parsed
from ndtorch.scenes import readers
from ndtorch.utils.packages import toml_file
from ndtorch.utils.toml import Strict, check, file_values, toml_values
from ndtorch_robot.sim.plan import Pattern, Plan, Point, Ring, SpawnPoints, circle, cylinder, ring

DOOR_SPACING, DOOR_WIDTH, NICHE = 1.308, 0.91, 0.10
"""Metres between neighbouring doors, as measured in the hallway of [A §2.3], their width, and depth of their niches."""

LEG, PLATE, INSET = 0.03, 0.03, 0.05
"""Width of the legs of chairs and tables, thickness of seats and tops, distance of legs from edges, m."""

STAIR = 0.9
"""Distance of a straight wall from the corners of the pixels of a map, at most, in pixels."""

Node = tuple[int, int]


class Box(NamedTuple):
    """A rectangle of floor, m. `kind` is what its walls look like where it is not open to another box."""

    left: float
    bottom: float
    right: float
    top: float
    kind: str = "wall"


def trace(rooms: list[Box], holes: Sequence[Box] = ()) -> tuple[Ring, tuple[Ring, ...]]:
    """The outline of the union of `rooms` less `holes`, and the rings of all inside it.

    Later boxes decide what a wall looks like. In a box of kind "door", a niche, the longer walls are the door and the
    shorter ones jambs.
    """
    boxes = [*rooms, *holes]
    xs = np.unique(np.round([v for box in boxes for v in (box.left, box.right)], 6))
    ys = np.unique(np.round([v for box in boxes for v in (box.bottom, box.top)], 6))
    free = np.zeros((len(xs) + 1, len(ys) + 1), dtype=bool)  # with a margin of what is not free
    for value, group in ((True, rooms), (False, holes)):
        for box in group:
            columns = (xs[:-1] >= box.left - 1e-6) & (xs[1:] <= box.right + 1e-6)
            rows = (ys[:-1] >= box.bottom - 1e-6) & (ys[1:] <= box.top + 1e-6)
            free[1:-1, 1:-1][np.ix_(columns, rows)] = value
    rings = [labelled([(float(xs[i]), float(ys[j])) for i, j in loop], boxes) for loop in border_loops(free)]
    outlines = [r for r in rings if r.area > 0]
    if len(outlines) != 1:
        raise InputError(f"the rooms must form one connected floor, got {len(outlines)} that do not touch")
    return outlines[0], tuple(r for r in rings if r.area < 0)


def border_loops(free: npt.NDArray[np.bool_]) -> Iterator[list[Node]]:
    """Closed lines between corners of cells, with free cells on their left; the outermost cells must not be free."""
    edges: dict[Node, list[Node]] = {}
    inner = free[1:-1, 1:-1]
    beside = free[1:-1, :-2] & free[2:, 1:-1] & free[1:-1, 2:] & free[:-2, 1:-1]
    for i, j in np.argwhere(inner & ~beside).tolist():
        low, high = (i, j), (i + 1, j + 1)
        for other, start, end in (
            ((i + 1, j), low, (high[0], low[1])),
            ((i + 2, j + 1), (high[0], low[1]), high),
            ((i + 1, j + 2), high, (low[0], high[1])),
            ((i, j + 1), (low[0], high[1]), low),
        ):
            if not free[other]:
                edges.setdefault(start, []).append(end)
    for start in sorted(edges):
        while edges[start]:
            yield next_loop(edges, start)


def next_loop(edges: dict[Node, list[Node]], start: Node) -> list[Node]:
    loop, node, before = [start], edges[start].pop(), start
    while node != start:
        loop.append(node)
        step = (node[0] - before[0], node[1] - before[1])
        # Where two corners touch, turning left keeps their floors apart.
        edges[node].sort(key=lambda to: -(step[0] * np.sign(to[1] - node[1]) - step[1] * np.sign(to[0] - node[0])))
        before, node = node, edges[node].pop(0)
    return loop


def labelled(points: list[Point], boxes: list[Box]) -> Ring:
    """A ring with the kinds of its walls, and without corners in the middle of straight walls of one kind."""
    lines, kept = list(zip(points, points[1:] + points[:1], strict=True)), []
    kinds = [surface_kind(a, b, boxes) for a, b in lines]
    for k, ((x, y), (bx, by)) in enumerate(lines):
        ax, ay = points[k - 1]
        if kinds[k] != kinds[k - 1] or abs((x - ax) * (by - y) - (y - ay) * (bx - x)) >= 1e-9:
            kept.append(k)
    return Ring(tuple(points[k] for k in kept), tuple(kinds[k] for k in kept))


def surface_kind(a: Point, b: Point, boxes: list[Box]) -> str:
    x, y = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
    kind = "wall"
    for box in boxes:
        within = box.left - 1e-6 <= x <= box.right + 1e-6 and box.bottom - 1e-6 <= y <= box.top + 1e-6
        if within and min(abs(x - box.left), abs(x - box.right), abs(y - box.bottom), abs(y - box.top)) < 1e-6:
            wide = box.right - box.left >= box.top - box.bottom
            across = wide != (abs(b[0] - a[0]) > abs(b[1] - a[1]))
            kind = "jamb" if box.kind == "door" and across else box.kind
    return kind


def box_ring(box: Box, height: float, bottom: float = 0.0) -> Ring:
    if bottom >= height:
        raise InputError(f"a box at ({box.left}, {box.bottom}) must have its bottom below its height")
    corners = [(box.left, box.bottom), (box.right, box.bottom), (box.right, box.top), (box.left, box.top)]
    return ring(corners, "furniture", height, solid=True, bottom=bottom)


def table_rings(box: Box, height: float, legs: float = LEG) -> list[Ring]:
    corners = [(x, y) for x in (box.left + INSET, box.right - INSET) for y in (box.bottom + INSET, box.top - INSET)]
    rings = [cylinder(*corner, legs / 2, height - PLATE, 6) for corner in corners]
    return [*rings, box_ring(box, height, height - PLATE)]


def hallway(seed: int) -> Plan:
    """A straight hallway, 18 x 2 m: niches with doors 1.308 m apart on both sides, pillars, end walls."""
    rng = np.random.default_rng((seed, 1))
    half, length = 1.0, 18.0
    rooms, holes, doors = [Box(0.0, -half, length, half)], [], []
    for side in (1, -1):
        first = float(rng.uniform(1.2, 1.9))
        for group in range(3):
            begin = first + group * 5.2
            row = [begin + k * DOOR_SPACING for k in range(3)]
            rooms += [mirrored(Box(x, half, x + DOOR_WIDTH, half + NICHE, "door"), side) for x in row]
            doors += [tuple((x + width, side * half) for x in row) for width in (0.0, DOOR_WIDTH)]
            post = begin + 3 * DOOR_SPACING + 0.25
            if post + 0.3 < length - 0.5:
                holes.append(mirrored(Box(post, half - 0.12, post + 0.3, half, "pillar"), side))
    outline, solids = trace(rooms, holes)
    start = (0.5, float(rng.uniform(-0.1, 0.1)), 0.0)
    return Plan("hallway", outline, solids, start, tuple(doors))


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


def loop(seed: int) -> Plan:
    """A corridor around a block: 13 x 10 m outside, 2.2 m wide, with some doors and a few pillars."""
    rng = np.random.default_rng((seed, 3))
    width, height, wide = 13.0, 10.0, 2.2
    rooms = [Box(0, 0, width, height)]
    for k in range(3):
        for bottom, top in ((-NICHE, 0), (height, height + NICHE)):
            x = 2.0 + 3.2 * k + float(rng.uniform(-0.4, 0.4))
            rooms.append(Box(x, bottom, x + DOOR_WIDTH, top, "door"))
    holes = [Box(wide, wide, width - wide, height - wide)]
    y = float(rng.uniform(3.5, 5.5))
    holes.append(Box(width - 0.15, y, width, y + 0.4, "pillar"))
    outline, solids = trace(rooms, holes)
    return Plan("loop", outline, solids, (float(rng.uniform(2.5, 5.0)), wide / 2, 0.0))


def room(seed: int) -> Plan:
    """A room of 8 x 8 m with two doors and five pillars, round and square."""
    rng = np.random.default_rng((seed, 4))
    side = 8.0
    x, y = (float(v) for v in rng.uniform(1.5, 5.5, 2))
    rooms = [Box(0, 0, side, side), Box(x, side, x + DOOR_WIDTH, side + NICHE, "door")]
    rooms.append(Box(side, y, side + NICHE, y + DOOR_WIDTH, "door"))
    outline, _ = trace(rooms)
    pillars: list[Point] = []
    while len(pillars) < 5:
        x, y = rng.uniform(1.6, side - 1.6, 2).tolist()
        if all(math.dist((x, y), other) > 2.0 for other in pillars):
            pillars.append((x, y))
    solids = []
    for k, p in enumerate(pillars):
        if k % 2:
            corners = circle(*p, float(rng.uniform(0.15, 0.3)), 16)
        else:
            corners = circle(*p, float(rng.uniform(0.3, 0.5)) / math.sqrt(2), 4, float(rng.uniform(0, 1.57)))
        solids.append(ring(corners, "pillar", solid=True))
    return Plan("room", outline, tuple(solids))


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


def chairs(seed: int) -> Plan:
    """A room of 7 x 7 m with five chairs and a table, on legs 3 cm wide."""
    rng = np.random.default_rng((seed, 10))
    side = 7.0
    outline, _ = trace([Box(0, 0, side, side)])
    places: list[Point] = []
    tries = 0
    while len(places) < 6:
        x, y = (float(v) for v in rng.uniform(1.3, side - 1.3, 2))
        tries += 1
        # Fewer far ones where they do not fit.
        if all(math.dist((x, y), other) > 1.7 * 0.98 ** (tries // 50) for other in places):
            places.append((x, y))
    solids = []
    for x, y in places[:5]:  # of a turned seat the part is drawn that every turn has in common
        legs = circle(x, y, 0.40 / np.sqrt(2), 4, float(rng.uniform(0, math.pi / 2)))
        solids += [cylinder(*corner, LEG / 2, 0.44, 6) for corner in legs]
        solids.append(box_ring(Box(x - 0.18, y - 0.18, x + 0.18, y + 0.18), 0.44 + PLATE, 0.44))
    x, y = places[5]
    solids += table_rings(Box(x - 0.6, y - 0.35, x + 0.6, y + 0.35), 0.72)
    return Plan("chairs", outline, tuple(solids))


def dead_end(seed: int) -> Plan:
    """A corridor 1.0 m wide that ends after 3.5 m; the car starts in it, its back to a room of 4 x 4 m."""
    rng = np.random.default_rng((seed, 13))
    y = float(rng.uniform(0.6, 2.4))
    outline, solids = trace([Box(0, 0, 4.0, 4.0), Box(4.0, y, 7.5, y + 1.0)])
    return Plan("dead-end", outline, solids, (4.6, y + 0.5, 0.0))


BUILDINGS = {make.__name__: make for make in (hallway, curve, loop, room, office)}
FLOORS: dict[str, Callable[[int], Plan]] = {"tiles": loop, "checker": loop, "smooth": loop, "lines": hallway}
"""Buildings with other floors: tiles of 30 cm with joints of 6 mm, light and dark checks of 25 cm, a floor almost
without texture, and dark lines of 3 cm across it every 2.5 m."""

FURNISHED = {"chairs": chairs, "dead-end": dead_end}
FILES = ("slalom", "sofa", "door-61", "door-81", "t-junction")
TESTS = (*FLOORS, *FURNISHED, *FILES)
ARENAS = (*BUILDINGS, *TESTS)
"""All arenas by name."""


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
        if self.round:
            return cylinder(self.x, self.y, self.width / 2, self.height, 12)
        corners = circle(self.x, self.y, self.width / math.sqrt(2), 4, math.pi / 4)
        return ring(corners, "pillar", self.height, solid=True)


class Block(Strict):
    """A box from `bottom` up to `height`, m, or a table of that height on four legs; a sill of 2 cm is driven over."""

    at: Four
    bottom: Annotated[float, Field(ge=0, le=10)] = 0.0
    height: Annotated[float, Field(gt=0, le=10)] = 0.72
    legs: Annotated[float, Field(ge=0.02, le=0.3)] = 0.04


class ArenaFile(Strict):
    """The keys of a file; docs/robot/simulation.md has one. Rectangles are left, bottom, right, top, m."""

    name: str
    description: str = ""
    rooms: Annotated[tuple[Four, ...], Field(min_length=1)]
    doors: tuple[Four, ...] = ()  # join rooms through thin walls
    pillars: tuple[Pillar, ...] = ()
    boxes: tuple[Block, ...] = ()  # low boxes, overhangs and sills
    tables: tuple[Block, ...] = ()
    floor: Pattern = "carpet"
    start: tuple[float, float, float] | None = None  # x, y, m, and heading, degrees
    height: Annotated[float, Field(ge=1, le=10)] = 2.4  # of the ceiling, m

    def plan(self, path: Path) -> Plan:
        rooms = [rectangle(room, NARROWEST, NARROWEST) for room in self.rooms]
        doors = [rectangle(door, CAR_WIDTH)._replace(kind="jamb") for door in self.doors]
        outline, inner = trace(rooms + doors)
        solids = [pillar.ring() for pillar in self.pillars]
        solids += [box_ring(rectangle(box.at), box.height, box.bottom) for box in self.boxes]
        solids += [part for t in self.tables for part in table_rings(rectangle(t.at), t.height, t.legs)]
        start = (*self.start[:2], math.radians(self.start[2])) if self.start else None
        return Plan(self.name, outline, (*inner, *solids), start, height=self.height, floor=self.floor).check()


class MapFile(Strict, extra="ignore"):
    """A map of ROS (`map_server`): an image whose dark pixels are walls, and where its lower left corner is."""

    image: Path
    resolution: Annotated[float, Field(gt=0, le=1)]  # m
    origin: tuple[float, float, float]  # x, y, m, and rotation, radians
    negate: bool = False
    free_thresh: Annotated[float, Field(gt=0, lt=1)] = 0.196
    occupied_thresh: Annotated[float, Field(gt=0, le=1)] = 0.65

    def plan(self, path: Path) -> Plan:
        """The largest connected floor of free pixels; all others, also the unknown ones, are walls."""
        with readers.quiet_opencv():
            read = cv2.imread(str(path.parent / self.image), cv2.IMREAD_GRAYSCALE)
        if read is None:
            raise InputError(f"its image {self.image} cannot be read")
        image = np.asarray(read, np.uint8)
        occupied = (image if self.negate else 255 - image)[::-1].T / 255.0
        free = (occupied < self.free_thresh).astype(np.uint8)
        count, numbers, stats, _ = cv2.connectedComponentsWithStats(free, connectivity=4)
        if count < 2:
            raise InputError("no pixel of the image is free")
        largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
        cos, sin = math.cos(self.origin[2]), math.sin(self.origin[2])
        turn = self.resolution * np.array([[cos, sin], [-sin, cos]])
        rings = []
        for loop in border_loops(np.pad(numbers == largest, 1)):
            corners = np.array(loop, np.float32)
            straight = cv2.approxPolyDP(corners[:, None], STAIR, True)[:, 0]
            area = abs(cv2.contourArea(straight)) > 0.5 * abs(cv2.contourArea(corners))
            points = ((straight if area else corners) @ turn + self.origin[:2]).tolist()
            rings.append(Ring(tuple((x, y) for x, y in points), ("wall",) * len(points)))
        outline = Plan(path.stem, max(rings, key=lambda r: r.area)).check().outline
        return Plan(path.stem, outline, tuple(r for r in rings if r is not outline))


def rectangle(at: Four, longest: float = 0.0, shortest: float = 0.0) -> Box:
    """A rectangle of a file, whose sides are at least so long."""
    box = Box(*at)
    sides = box.right - box.left, box.top - box.bottom
    if min(sides) <= 0 or max(sides) < longest - 1e-6 or min(sides) < shortest - 1e-6:
        least = f" and at least {longest} m wide" if longest else ""
        raise InputError(f"{list(at)} must be left, bottom, right, top{least}")
    return box


def load_arena(name: str, seed: int = 0) -> Plan:
    """The plan of an arena by name, of a `.toml` file, or of a map of ROS, a `.yaml` file."""
    if name in FLOORS:
        return replace(FLOORS[name](seed), name=name, floor=cast("Pattern", name))
    if name in BUILDINGS | FURNISHED:
        return (BUILDINGS | FURNISHED)[name](seed)
    is_map = name.endswith((".yaml", ".yml"))
    if name not in FILES and not is_map and not name.endswith(".toml"):
        words = f"choose one of {', '.join(ARENAS)} or a .toml or .yaml file"
        raise InputError(f"no arena {name!r}, {words}{did_you_mean(name, ARENAS)}")
    path = Path(name) if is_map else toml_file(Path(name), "ndtorch_robot", "arenas")
    kind: type[MapFile | ArenaFile] = MapFile if is_map else ArenaFile
    file = check(file_values(path, parsed, "YAML") if is_map else toml_values(path), kind, str(path))
    try:
        plan = file.plan(path)
        SpawnPoints(plan)
        return plan
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def describe_arena(name: str) -> str:
    if name in FILES:
        return str(toml_values(toml_file(Path(name), "ndtorch_robot", "arenas"))["description"])
    if name in FLOORS:
        return f"The {FLOORS[name].__name__} with another floor: {name}."
    return ((BUILDINGS | FURNISHED)[name].__doc__ or "").splitlines()[0]
