"""Rings from rectangles: the walls around rooms, corridors and niches, and furniture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ndtorch.errors import InputError
from ndtorch_robot.sim.plan import Point, Ring, circle, cylinder, ring

LEG, PLATE, INSET = 0.03, 0.03, 0.05
"""Width of the legs of chairs and tables, thickness of seats and tops, and distance of legs from the edges, m."""

Node = tuple[int, int]


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
    edges: dict[Node, list[Node]] = {}  # between corners of cells, with free floor on their left
    for i, j in np.argwhere(free).tolist():
        low, high = (i - 1, j - 1), (i, j)
        for beside, start, end in (
            ((i, j - 1), low, (high[0], low[1])),
            ((i + 1, j), (high[0], low[1]), high),
            ((i, j + 1), high, (low[0], high[1])),
            ((i - 1, j), (low[0], high[1]), low),
        ):
            if not free[beside]:
                edges.setdefault(start, []).append(end)
    rings = []
    while edges:
        rings.append(labelled([(float(xs[i]), float(ys[j])) for i, j in next_loop(edges)], boxes))
    outlines = [r for r in rings if r.area > 0]
    if len(outlines) != 1:
        raise InputError(f"the rooms must form one connected floor, got {len(outlines)} that do not touch")
    return outlines[0], tuple(r for r in rings if r.area < 0)


def next_loop(edges: dict[Node, list[Node]]) -> list[Node]:
    """A closed line of edges, which are removed."""
    start = min(edges)
    loop, node, before = [start], edges[start].pop(), start
    while node != start:
        loop.append(node)
        step = (node[0] - before[0], node[1] - before[1])
        # Where two corners touch, turning left keeps their floors apart.
        edges[node].sort(key=lambda to: -(step[0] * np.sign(to[1] - node[1]) - step[1] * np.sign(to[0] - node[0])))
        before, node = node, edges[node].pop(0)
    for done in [n for n, targets in edges.items() if not targets]:
        del edges[done]
    return loop


def labelled(points: list[Point], boxes: list[Box]) -> Ring:
    """A ring with the kinds of its walls, and without corners in the middle of straight walls of one kind."""
    kinds = [surface_kind(a, b, boxes) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    kept = []
    for k, (x, y) in enumerate(points):
        (ax, ay), (bx, by) = points[k - 1], points[(k + 1) % len(points)]
        if kinds[k] != kinds[k - 1] or abs((x - ax) * (by - y) - (y - ay) * (bx - x)) >= 1e-9:
            kept.append(k)
    return Ring(tuple(points[k] for k in kept), tuple(kinds[k] for k in kept))


def surface_kind(a: Point, b: Point, boxes: list[Box]) -> str:
    """What the wall from a to b looks like: the last box that has it as a side decides."""
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
    """A piece of furniture."""
    corners = [(box.left, box.bottom), (box.right, box.bottom), (box.right, box.top), (box.left, box.top)]
    return ring(corners, "furniture", height, solid=True, bottom=bottom)


def chair_rings(x: float, y: float, turned: float) -> list[Ring]:
    """Four legs and a seat, turned by radians; of the seat only the part is drawn that every turn has in common."""
    legs = [cylinder(*corner, LEG / 2, 0.44, 6) for corner in circle(x, y, 0.40 / np.sqrt(2), 4, turned)]
    half = 0.18
    return [*legs, box_ring(Box(x - half, y - half, x + half, y + half), 0.44 + PLATE, 0.44)]


def table_rings(box: Box, height: float, legs: float = LEG) -> list[Ring]:
    """Four legs and a top."""
    corners = [(x, y) for x in (box.left + INSET, box.right - INSET) for y in (box.bottom + INSET, box.top - INSET)]
    rings = [cylinder(*corner, legs / 2, height - PLATE, 6) for corner in corners]
    return [*rings, box_ring(box, height, height - PLATE)]
