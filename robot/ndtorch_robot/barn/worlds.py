"""The worlds of the BARN challenge out of their file, as buildings to drive in."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

from ndtorch.errors import InputError
from ndtorch.utils.files import TABLE_BYTES, read_text
from ndtorch_robot.sim.plan import Plan, Point, cylinder, ring

AROUND = 1.2
"""Metres between the cylinders or the goal and the walls of the hall around them."""

TEST_EVERY = 5
"""Worlds whose number this divides are for reports; nothing is tuned on them."""

OPTIMAL_SPEED = 2.0
"""m/s with which the shortest path becomes the optimal time of the score."""


@dataclass(frozen=True)
class World:
    """One world.

    Attributes:
        number: of the challenge.
        cylinders: their middles, m.
        radius, height: of all cylinders, m.
        start: x, y, m, and heading, radians.
        goal: m.
        within: the goal is reached this near to it, m.
        limit: time allowed, s.
        path: length of the shortest path, m.
    """

    number: int
    cylinders: tuple[Point, ...]
    radius: float
    height: float
    start: tuple[float, float, float]
    goal: Point
    within: float
    limit: float
    path: float

    @property
    def is_test(self) -> bool:
        """Whether the world is kept for reports."""
        return self.number % TEST_EVERY == 0

    def score(self, seconds: float | None) -> float:
        """`OT / clip(AT, 2 OT, 8 OT)` for a goal reached after so many seconds, 0 for None; at most 0.5."""
        if seconds is None:
            return 0.0
        optimal = self.path / OPTIMAL_SPEED
        return optimal / min(max(seconds, 2 * optimal), 8 * optimal)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of the hall, m."""
        xs, ys = zip(*self.cylinders, self.start[:2], self.goal, strict=True)
        return min(xs) - AROUND, max(xs) + AROUND, min(ys) - AROUND, max(ys) + AROUND

    def plan(self) -> Plan:
        """The cylinders in a hall."""
        left, right, bottom, top = self.bounds
        hall = ring([(left, bottom), (right, bottom), (right, top), (left, top)])
        solids = tuple(cylinder(x, y, self.radius, self.height) for x, y in self.cylinders)
        return Plan(f"barn-{self.number}", hall, solids, self.start)


def read_worlds(file: Path) -> list[World]:
    """All worlds of a file.

    Raises:
        InputError: a file that cannot be read or holds something else.
    """
    try:
        found = json.loads(read_text(file, TABLE_BYTES))
        x, y, degrees = found["start"]
        start, goal = (float(x), float(y), math.radians(degrees)), (float(found["goal"][0]), float(found["goal"][1]))
        return [
            World(
                int(w["world"]),
                tuple((float(a), float(b)) for a, b in w["cylinders"]),
                float(found["radius_m"]),
                float(found["height_m"]),
                start,
                goal,
                float(found["goal_radius_m"]),
                float(found["time_limit_s"]),
                float(w["path_m"]),
            )
            for w in found["worlds"]
        ]
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from None
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, IndexError, OverflowError, RecursionError) as error:
        raise InputError(f"{file}: not a file of BARN worlds ({type(error).__name__}: {error})") from None
