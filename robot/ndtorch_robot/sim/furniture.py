"""Furniture as rings: boxes with air below, chairs and tables on thin legs."""

from __future__ import annotations

from ndtorch_robot.sim.plan import Ring, cylinder, ring, square
from ndtorch_robot.sim.tracing import Box

LEG = 0.03
"""Width of the legs of chairs and tables, m."""

PLATE = 0.03
"""How thick seats and table tops are, m."""

INSET = 0.05
"""Metres from the edges of a table to its legs."""


def box_ring(box: Box, height: float, bottom: float = 0.0) -> Ring:
    """A box from `bottom` to `height`."""
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
    standing = [cylinder(*place, legs / 2, height - PLATE, 6) for place in places]
    return [*standing, box_ring(box, height, height - PLATE)]
