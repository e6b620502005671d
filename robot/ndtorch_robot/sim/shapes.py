"""Rings from rectangles: the walls around rooms, corridors and niches, and furniture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ndtorch.errors import InputError
from ndtorch_robot.sim.plan import Point, Ring, cylinder, ring, square

LEG = 0.03
"""Width of the legs of chairs and tables, m."""

PLATE = 0.03
"""How thick seats and table tops are, m."""

INSET = 0.05
"""Metres from the edges of a table to its legs."""


class Box(NamedTuple):
    """A rectangle of floor, m. `kind` is what its walls look like where it is not open to another box."""

    left: float
    bottom: float
    right: float
    top: float
    kind: str = "wall"


def trace(rooms: list[Box], holes: list[Box] | None = None) -> tuple[Ring, tuple[Ring, ...]]:
    """The outline of the union of `rooms` less `holes`, and the rings of all inside it.

    Later boxes decide what a wall looks like. In a box of kind "door", a niche, the longer walls are the door and the
    shorter ones jambs.
    """
    holes = holes or []
    boxes = rooms + holes
    xs = np.unique(np.round([v for box in boxes for v in (box.left, box.right)], 6))
    ys = np.unique(np.round([v for box in boxes for v in (box.bottom, box.top)], 6))
    free = np.zeros((len(xs) + 1, len(ys) + 1), dtype=bool)  # with a margin of what is not free
    for value, group in ((True, rooms), (False, holes)):
        for box in group:
            columns = (xs[:-1] >= box.left - 1e-6) & (xs[1:] <= box.right + 1e-6)
            rows = (ys[:-1] >= box.bottom - 1e-6) & (ys[1:] <= box.top + 1e-6)
            free[1:-1, 1:-1][np.ix_(columns, rows)] = value
    edges = boundary(free)
    rings = []
    while edges:
        loop = next_loop(edges)
        rings.append(label([(float(xs[i]), float(ys[j])) for i, j in loop], boxes))
    outlines = [r for r in rings if r.area > 0]
    if len(outlines) != 1:
        raise InputError(f"the rooms must form one connected floor, got {len(outlines)} that do not touch")
    return outlines[0], tuple(r for r in rings if r.area < 0)


Node = tuple[int, int]


def boundary(free: np.ndarray) -> dict[Node, list[Node]]:
    """Directed edges between grid corners that have free floor on their left."""
    edges: dict[Node, list[Node]] = {}

    def add(a: Node, b: Node) -> None:
        edges.setdefault(a, []).append(b)

    for i, j in zip(*np.nonzero(free), strict=True):
        low, high = (int(i) - 1, int(j) - 1), (int(i), int(j))  # corners of the cell, without the margin
        if not free[i, j - 1]:
            add(low, (high[0], low[1]))
        if not free[i + 1, j]:
            add((high[0], low[1]), high)
        if not free[i, j + 1]:
            add(high, (low[0], high[1]))
        if not free[i - 1, j]:
            add((low[0], high[1]), low)
    return edges


def next_loop(edges: dict[Node, list[Node]]) -> list[Node]:
    start = min(edges)
    loop, here, before = [start], edges[start].pop(), start
    while here != start:
        loop.append(here)
        choices = edges[here]
        step = (here[0] - before[0], here[1] - before[1])
        # Where two corners touch, turning left keeps their floors apart.
        choices.sort(key=lambda to: -(step[0] * np.sign(to[1] - here[1]) - step[1] * np.sign(to[0] - here[0])))
        before, here = here, choices.pop(0)
    for node in [n for n, targets in edges.items() if not targets]:
        del edges[node]
    return loop


def label(points: list[Point], boxes: list[Box]) -> Ring:
    """A ring with the kinds of its walls, and without corners in the middle of straight walls of one kind."""
    kinds = [surface(a, b, boxes) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    kept = []
    for k, (x, y) in enumerate(points):
        (ax, ay), (bx, by) = points[k - 1], points[(k + 1) % len(points)]
        straight = abs((x - ax) * (by - y) - (y - ay) * (bx - x)) < 1e-9
        if not (straight and kinds[k] == kinds[k - 1]):
            kept.append(k)
    return Ring(tuple(points[k] for k in kept), tuple(kinds[k] for k in kept))


def surface(a: Point, b: Point, boxes: list[Box]) -> str:
    """What the wall from a to b looks like: the last box that has it as a side decides."""
    x, y = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
    kind = "wall"
    for box in boxes:
        within = box.left - 1e-6 <= x <= box.right + 1e-6 and box.bottom - 1e-6 <= y <= box.top + 1e-6
        on_side = min(abs(x - box.left), abs(x - box.right), abs(y - box.bottom), abs(y - box.top)) < 1e-6
        if within and on_side:
            wide = box.right - box.left >= box.top - box.bottom
            across = wide != (abs(b[0] - a[0]) > abs(b[1] - a[1]))
            kind = "jamb" if box.kind == "door" and across else box.kind
    return kind


def box_ring(box: Box, height: float, bottom: float = 0.0) -> Ring:
    corners = [(box.left, box.bottom), (box.right, box.bottom), (box.right, box.top), (box.left, box.top)]
    return ring(corners, "furniture", height, solid=True, bottom=bottom)


def chair_rings(x: float, y: float, turned: float) -> list[Ring]:
    """Four legs and a seat, turned by radians; of the seat only the part is drawn that every turn has in common."""
    legs = [cylinder(*corner, LEG / 2, 0.44, 6) for corner in square(x, y, 0.40, turned)]
    half = 0.18
    return [*legs, box_ring(Box(x - half, y - half, x + half, y + half), 0.44 + PLATE, 0.44)]


def table_rings(box: Box, height: float, legs: float = LEG) -> list[Ring]:
    """Four legs and a top."""
    places = [(x, y) for x in (box.left + INSET, box.right - INSET) for y in (box.bottom + INSET, box.top - INSET)]
    rings = [cylinder(*place, legs / 2, height - PLATE, 6) for place in places]
    return [*rings, box_ring(box, height, height - PLATE)]
