"""The plan of a building: closed rings of vertical surfaces, and geometry in the plane."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError
from ndtorch.navigation import Grid

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Point = tuple[float, float]
Pattern = Literal["carpet", "tiles", "checker", "smooth", "lines"]

OVERHEAD, DRIVEN_OVER = 0.25, 0.02
"""Metres: what hangs higher than the first is above the car (0.19 m high), what is lower than the second is a sill."""

WIDEST, STEP = 100.0, 0.2
"""Metres of a side of a building, whose floor is one texture, and between places where a drive could begin, at most."""


@dataclass(frozen=True)
class Ring:
    """A closed polygon of vertical surfaces.

    The corners of an outline run counter-clockwise, those of solids clockwise, so that the free side is on the left.
    """

    points: tuple[Point, ...]
    kinds: tuple[str, ...]  # one of `textures.COLORS` for the surface from each corner to the next
    height: float | None = None  # m; None is up to the ceiling
    radius: float = 0.0  # of the cylinder about the middle of its corners that it approximates, m; 0: the polygon
    bottom: float = 0.0  # m; there is air below it

    @property
    def stops(self) -> bool:
        """Whether it hangs too low for a car to pass below, and lies too high to drive over."""
        return self.bottom < OVERHEAD and (self.height is None or self.height > DRIVEN_OVER)

    @cached_property
    def array(self) -> Floats:
        return np.array(self.points, dtype=np.float64)

    @property
    def sides(self) -> Floats:
        """Surfaces `[N, 2, 2]`: from, to; x, y."""
        return np.stack((self.array, np.roll(self.array, -1, 0)), 1)

    @property
    def area(self) -> float:
        """Signed area, m^2, positive when counter-clockwise."""
        x, y = self.array.T
        return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


def ring(
    points: list[Point], kind: str = "wall", height: float | None = None, solid: bool = False, bottom: float = 0.0
) -> Ring:
    """A ring of one kind of surface, turned to have its free side on the left."""
    made = Ring(tuple(points), (kind,) * len(points), height, bottom=bottom)
    return replace(made, points=made.points[::-1]) if (made.area < 0) != solid else made


def cylinder(x: float, y: float, radius: float, height: float | None, corners: int = 8) -> Ring:
    """A round pillar, bumped into as a cylinder and drawn as a polygon that is as wide on the average."""
    wide = radius * 2 / (1 + math.cos(math.pi / corners))
    return replace(ring(circle(x, y, wide, corners), "pillar", height, solid=True), radius=radius)


def circle(x: float, y: float, radius: float, corners: int, turned: float = 0.0) -> list[Point]:
    angles = turned + np.arange(corners) * (2 * math.pi / corners)
    return [(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles]


@dataclass(frozen=True)
class Plan:
    """A building: the free space inside `outline` and outside all `solids`."""

    name: str
    outline: Ring
    solids: tuple[Ring, ...] = ()  # pillars, furniture, inner walls
    start: tuple[float, float, float] | None = None  # x, y, m, and heading, radians; None lets the seed choose
    doors: tuple[tuple[Point, ...], ...] = ()  # rows of corners that are one door apart, for scoring their spacing
    height: float = 2.4  # of the ceiling, m
    floor: Pattern = "carpet"

    def check(self) -> Plan:
        """The plan itself; raises `InputError` for one of a file that cannot be built."""
        wide, deep = np.ptp(self.outline.array, 0)
        if not max(wide, deep) <= WIDEST:
            raise InputError(f"{wide:.4g} x {deep:.4g} m is too large, {WIDEST:g} m a side are the most")
        for solid in self.solids:
            x, y = solid.array.mean(0)
            if not inside(self.outline, np.array([[x, y]]))[0]:
                raise InputError(f"a {solid.kinds[0]} at ({x:.2f}, {y:.2f}) is outside the walls")
        if self.start is not None and not (self.clearance(np.array([self.start[:2]]))[0] > 0.3):
            raise InputError(f"start {self.start[:2]} must be free for 0.3 m all around")
        return self

    @property
    def rings(self) -> tuple[Ring, ...]:
        return (self.outline, *self.solids)

    @cached_property
    def segments(self) -> Floats:
        """All surfaces, `[S, 2, 2]`: from, to; x, y."""
        return np.concatenate([r.sides for r in self.rings])

    @cached_property
    def in_the_way(self) -> Floats:
        """Those of the surfaces that a car cannot pass, `[N, 2, 2]`."""
        return np.concatenate([r.sides for r in self.rings if r.stops])

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Smallest and largest x, smallest and largest y, m."""
        (left, bottom), (right, top) = self.outline.array.min(0), self.outline.array.max(0)
        return float(left), float(right), float(bottom), float(top)

    def grid(self) -> Grid:
        left, right, bottom, top = self.bounds
        return Grid(left - 0.5, right + 0.5, bottom - 0.5, top + 0.5)

    def clearance(self, points: Floats) -> Floats:
        """Distance of points `[N, 2]` from the nearest surface, m, `[N]`; negative where it is not free."""
        free, best = inside(self.outline, points), away(points, self.in_the_way)
        for solid in self.solids:
            if solid.stops:
                free &= ~inside(solid, points)
        return np.where(free, best, -best)

    def cast(self, origin: Floats, angles: Floats) -> Floats:
        """Distance from `origin` (x, y) to the first surface in world directions `[N]`, m; inf where there is none."""
        a, b = self.in_the_way[:, 0], self.in_the_way[:, 1]
        x, y = np.cos(angles)[:, None], np.sin(angles)[:, None]
        (along_x, along_y), (to_x, to_y) = (b - a).T, (a - origin).T
        cross = x * along_y - y * along_x
        cross = np.where(np.abs(cross) > 1e-12, cross, np.nan)
        distance, ratio = (to_x * along_y - to_y * along_x) / cross, (to_x * y - to_y * x) / cross
        hit = (distance > 1e-9) & (ratio >= -1e-9) & (ratio <= 1 + 1e-9)
        return np.asarray(np.where(hit, distance, np.inf).min(-1))


def away(points: Floats, segments: Floats) -> Floats:
    """Distance of points `[N, 2]` from the nearest of segments `[S, 2, 2]`, m, `[N]`; inf where there are none."""
    best = np.full(len(points), np.inf)
    for a, b in segments:
        along = b - a
        ratio = np.clip(((points - a) @ along) / max(float(along @ along), 1e-12), 0.0, 1.0)
        best = np.minimum(best, np.hypot(*(points - a - ratio[:, None] * along).T))
    return best


def inside(shape: Ring, points: Floats) -> Bools:
    """Whether points `[N, 2]` lie inside a ring: a ray to the right crosses it an odd number of times."""
    result = np.zeros(len(points), dtype=bool)
    x, y = points.T
    for (ax, ay), (bx, by) in shape.sides:
        if ay != by:
            result ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * ((bx - ax) / (by - ay)))
    return result


class SpawnPoints:
    """Places of a plan where a robot whose body has this unit, m, fits.

    The car of [A] needs a place .7 m wide, and prefers 1.2 m. Raises `InputError` where there is none.
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

    def by_distance(self, x: float, y: float) -> Iterator[tuple[float, float, float]]:
        """All places, the nearest first, each with its best heading."""
        for k in np.hypot(*(self.points - np.array((x, y))).T).argsort(kind="stable"):
            point = self.points[k].tolist()
            yield point[0], point[1], self.heading(*point)

    def heading(self, x: float, y: float) -> float:
        """Of 24 directions the one in which a car can drive farthest."""
        angles: Floats = np.arange(24, dtype=np.float64) * (2 * math.pi / 24)
        return float(angles[int(self.lengths(x, y, angles).argmax())])

    def lengths(self, x: float, y: float, angles: Floats) -> Floats:
        """How far the robot could go straight on in each direction, m."""
        half_width = 0.25 * self.unit
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
