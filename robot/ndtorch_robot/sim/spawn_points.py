"""Free places: where a drive can begin, and where the car is put back after a collision."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ndtorch.errors import InputError
from ndtorch_robot.sim.plan import Floats, Plan, Point

STEP = 0.2
"""Spacing of the places that are tried, m, at most."""


class SpawnPoints:
    """Places of a plan where the robot fits.

    Args:
        unit: of its body, m: the car of [A] needs a place .7 m wide, and prefers 1.2 m.

    Raises:
        InputError: there is none.
    """

    def __init__(self, plan: Plan, unit: float = 1.0) -> None:
        self.plan, self.unit = plan, unit
        left, right, bottom, top = plan.bounds
        step = STEP * min(1.0, 2 * unit)
        x, y = np.arange(left, right, step) + step / 2, np.arange(bottom, top, step) + step / 2
        points = np.stack([axis.ravel() for axis in np.meshgrid(x, y, indexing="ij")], -1)
        clear = plan.clearance(points)
        self.free = points[clear > 0]
        self.points = points[clear >= min(0.6 * unit, 0.95 * float(clear.max()))]
        if clear.max() < 0.35 * unit:
            raise InputError(f"arena {plan.name}: nowhere as wide as the robot needs ({0.7 * unit:.3g} m)")

    def random(self, rng: np.random.Generator) -> tuple[float, float, float]:
        x, y = self.points[int(rng.integers(len(self.points)))].tolist()
        return x, y, self.heading(x, y)

    def by_distance(self, x: float, y: float, away_from: Point | None = None) -> Iterator[tuple[float, float, float]]:
        """All places at least 1.2 m from `away_from`, the nearest first, each with its best heading."""
        points = self.far_from(away_from, 1.2)
        for k in np.hypot(*(points - np.array((x, y))).T).argsort(kind="stable"):
            yield float(points[k][0]), float(points[k][1]), self.heading(float(points[k][0]), float(points[k][1]))

    def far_from(self, place: Point | None, least: float) -> Floats:
        far = np.hypot(*(self.points - np.array(place or (math.inf, 0.0))).T) > least
        return self.points[far] if far.any() else self.points

    def heading(self, x: float, y: float) -> float:
        """Of 24 directions the one in which a car can drive farthest."""
        angles: Floats = np.arange(24, dtype=np.float64) * (2 * math.pi / 24)
        return float(angles[int(self.lengths(x, y, angles).argmax())])

    def lengths(self, x: float, y: float, angles: Floats, half_width: float | None = None) -> Floats:
        """How far the robot, or something else of this width, could go straight on in each direction, m."""
        half_width = 0.25 * self.unit if half_width is None else half_width
        cos, sin = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
        dx, dy = np.moveaxis(self.plan.in_the_way - np.array((x, y)), -1, 0)
        ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
        # A surface is nearest where it ends in the strip that the robot covers, or where it enters it.
        best = np.where((np.abs(aside) <= half_width) & (ahead > 0), ahead, np.inf).min((1, 2))
        along, across = np.diff(ahead)[..., 0], np.diff(aside)[..., 0]
        for edge in (-half_width, half_width):
            ratio = (edge - aside[..., 0]) / np.where(across == 0, np.nan, across)
            at = ahead[..., 0] + ratio * along
            best = np.minimum(best, np.where((ratio >= 0) & (ratio <= 1) & (at > 0), at, np.inf).min(1))
        return np.asarray(best)

    def walk(self, rng: np.random.Generator, avoid: Point) -> tuple[Point, Point]:
        """Two places with nothing in between, at most 4 m apart and away from `avoid`, to walk to and fro."""
        points, best, ends = self.far_from(avoid, 2.0), 0.0, None
        for _ in range(20):
            x, y = points[int(rng.integers(len(points)))].tolist()
            angle = float(rng.uniform(0, 2 * math.pi))
            length = min(4.0, float(self.lengths(x, y, np.array([angle]), 0.35)[0]) - 0.5)
            if length > best:
                best, ends = length, ((x, y), (x + length * math.cos(angle), y + length * math.sin(angle)))
        if ends is None:
            raise InputError(f"arena {self.plan.name} has no room for a pedestrian")
        return ends
