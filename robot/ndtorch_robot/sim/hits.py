"""Collisions: where they were, what was hit, and who was driving."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from ndtorch_robot.sim.plan import Point

SAME_PLACE = 0.5
"""Metres: collisions nearer to the first at a place than this are at the same place."""

STANDS = 0.02
"""m/s: a car slower than this stands."""


class Collision(NamedTuple):
    """When and where the car hit something, or was hit.

    Attributes:
        time: s.
        x, y, heading: of the car, m and radians.
        person: it was the walking obstacle.
        standing: the car stood, so that the other one hit it.
    """

    time: float
    x: float
    y: float
    heading: float
    person: bool = False
    standing: bool = False


def places_of(collisions: Sequence[Collision]) -> list[Point]:
    """The places at which there was a collision, each where the first one was."""
    found: list[Point] = []
    for hit in collisions:
        if all(math.dist((hit.x, hit.y), place) > SAME_PLACE for place in found):
            found.append((hit.x, hit.y))
    return found


def hits_summary(collisions: Sequence[Collision]) -> dict[str, object]:
    """For `summary.json`: how many collisions there were, at how many places, and with whom."""
    return {
        "collisions": len(collisions),
        "collision_places": len(places_of([hit for hit in collisions if not hit.person])),
        "people_hit": sum(hit.person and not hit.standing for hit in collisions),
        "hit_while_standing": sum(hit.standing for hit in collisions),
    }
