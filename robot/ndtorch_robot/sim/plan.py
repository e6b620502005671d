"""The plan of a building: closed rings of vertical walls, and what can be asked of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError, did_you_mean
from ndtorch.navigation import Grid
from ndtorch_robot.sim.floors import Floor

Floats = npt.NDArray[np.float64]
Point = tuple[float, float]

KINDS = ("wall", "blank", "door", "jamb", "pillar", "furniture")
"""What a surface looks like."""

NARROWEST = 0.6
"""Metres: a passage narrower than this leaves the car (0.36 m wide) no room to steer."""

OVERHEAD = 0.25
"""Metres: what hangs higher than this over the floor is above the car (0.19 m high)."""

DRIVEN_OVER = 0.02
"""Metres: what lies lower than this on the floor is driven over, such as a sill or a cable."""


@dataclass(frozen=True)
class Ring:
    """A closed polygon of vertical surfaces.

    Args:
        points: corners in order, m. Those of an outline run counter-clockwise, those of solids clockwise, so
            that the free side is always on the left; `ring` turns them round where needed.
        kinds: one of `KINDS` for the surface from each corner to the next.
        height: m; None is up to the ceiling.
        bottom: m; there is air below it.
        radius: the ring approximates a cylinder of this radius about the middle of its corners, m; 0 is the polygon.
    """

    points: tuple[Point, ...]
    kinds: tuple[str, ...]
    height: float | None = None
    radius: float = 0.0
    bottom: float = 0.0

    @property
    def stops(self) -> bool:
        """Whether a car cannot drive here: it hangs too low to pass below, and lies too high to drive over."""
        return self.bottom < OVERHEAD and (self.height is None or self.height > DRIVEN_OVER)

    @cached_property
    def array(self) -> Floats:
        """Corners `[N, 2]`."""
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

    def flipped(self) -> Ring:
        points = tuple(reversed(self.points))
        kinds = tuple(reversed(self.kinds[:-1])) + self.kinds[-1:]
        return replace(self, points=points, kinds=kinds)


def ring(
    points: list[Point], kind: str = "wall", height: float | None = None, solid: bool = False, bottom: float = 0.0
) -> Ring:
    """A ring of one kind of surface, turned to have its free side on the left."""
    made = Ring(tuple(points), (kind,) * len(points), height, bottom=bottom)
    return made.flipped() if (made.area < 0) != solid else made


def cylinder(x: float, y: float, radius: float, height: float, corners: int = 8) -> Ring:
    """A round pillar, bumped into as a cylinder and drawn as a polygon that is as wide on the average."""
    wide = radius * 2 / (1 + math.cos(math.pi / corners))
    return replace(ring(circle(x, y, wide, corners), "pillar", height, solid=True), radius=radius)


def circle(x: float, y: float, radius: float, corners: int) -> list[Point]:
    angles = np.arange(corners) * (2 * math.pi / corners)
    return [(x + radius * math.cos(a), y + radius * math.sin(a)) for a in angles]


def square(x: float, y: float, side: float, turned: float) -> list[Point]:
    radius, angles = side / math.sqrt(2), [turned + k * math.pi / 2 for k in range(4)]
    return [(x + radius * math.cos(angle), y + radius * math.sin(angle)) for angle in angles]


WIDEST = 500.0
"""Metres of a side of a building, at most: places to begin at are looked for on a grid of all of it."""


@dataclass(frozen=True)
class Plan:
    """A building: the free space inside `outline` and outside all `solids`.

    Args:
        name: of the arena.
        outline: ring around everything.
        solids: pillars, furniture, inner walls.
        start: x, y in m and heading in radians where a drive begins; None lets the seed choose.
        doors: rows of corners that are one door apart, for scoring the spacing of doors.
        spacing: distance between neighbouring doors, m; 0 where there are none.
        height: of the ceiling, m.
        floor: what it looks like.
        gates: lines from place to place; a drive counts those that the car has crossed.
        remarks: what a user may not have meant, one line each.

    Raises:
        InputError: a plan that cannot be built, in one line that says where.
    """

    name: str
    outline: Ring
    solids: tuple[Ring, ...] = ()
    start: tuple[float, float, float] | None = None
    doors: tuple[tuple[Point, ...], ...] = field(default=())
    spacing: float = 0.0
    height: float = 2.4
    floor: Floor = field(default_factory=Floor)
    gates: tuple[tuple[Point, Point], ...] = ()
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 1.0 <= self.height <= 10.0:
            raise InputError(f"arena {self.name}: height must be 1 to 10 m, got {self.height}")
        for shape in self.rings:
            check_ring(shape, self.name)
        wide, deep = np.ptp(self.outline.array, 0)
        if not max(wide, deep) <= WIDEST:
            words = f"{wide:.4g} x {deep:.4g} m is too large, {WIDEST:g} m a side are the most"
            raise InputError(f"arena {self.name}: {words}")
        for solid in self.solids:
            x, y = solid.array.mean(0)
            if not inside(self.outline, np.array([[x, y]]))[0]:
                raise InputError(f"arena {self.name}: a {solid.kinds[0]} at ({x:.2f}, {y:.2f}) is outside the walls")
        if self.start is not None and not (self.clearance(np.array([self.start[:2]]))[0] > 0.3):
            x, y, _ = self.start
            raise InputError(f"arena {self.name}: start ({x}, {y}) must be free for 0.3 m all around")

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
        """Of a map of the building, with half a metre around it."""
        left, right, bottom, top = self.bounds
        return Grid(left - 0.5, right + 0.5, bottom - 0.5, top + 0.5)

    def is_free(self, points: Floats) -> npt.NDArray[np.bool_]:
        """Whether points `[N, 2]` are in free space, `[N]`."""
        free = inside(self.outline, points)
        for solid in self.solids:
            if solid.stops:
                free &= ~inside(solid, points)
        return free

    def clearance(self, points: Floats) -> Floats:
        """Distance of points `[N, 2]` from the nearest surface, m, `[N]`; negative where it is not free."""
        best = away(points, self.in_the_way)
        return np.where(self.is_free(points), best, -best)

    def cast(self, origin: Floats, angles: Floats) -> Floats:
        """Distance from `origin` (x, y) to the first surface in world directions `[N]`, m; inf where there is none."""
        a, b = self.in_the_way[:, 0], self.in_the_way[:, 1]
        ray = np.stack((np.cos(angles), np.sin(angles)), -1)[:, None]
        distance, share = crossing(origin, ray, a, b - a)
        hit = (distance > 1e-9) & (share >= -1e-9) & (share <= 1 + 1e-9)
        return np.asarray(np.where(hit, distance, np.inf).min(-1))

    def sees(self, origin: Floats, targets: Floats, margin: float = 0.02) -> npt.NDArray[np.bool_]:
        """Whether nothing lies between `origin` and targets `[N, 2]`, up to `margin` metres before them."""
        offset = targets - origin
        reach = self.cast(origin, np.arctan2(offset[:, 1], offset[:, 0]))
        return np.asarray(reach >= np.hypot(*offset.T) - margin)


def crossing(origin: Floats, ray: Floats, start: Floats, along: Floats) -> tuple[Floats, Floats]:
    """Where the lines `origin + s ray` and `start + t along`, `[..., 2]`, cross: s and t, NaN where parallel."""
    to = start - origin
    cross = ray[..., 0] * along[..., 1] - ray[..., 1] * along[..., 0]
    cross = np.where(np.abs(cross) > 1e-12, cross, np.nan)
    return (
        (to[..., 0] * along[..., 1] - to[..., 1] * along[..., 0]) / cross,
        (to[..., 0] * ray[..., 1] - to[..., 1] * ray[..., 0]) / cross,
    )


def away(points: Floats, segments: Floats) -> Floats:
    """Distance of points `[N, 2]` from the nearest of segments `[S, 2, 2]`, m, `[N]`; inf where there are none."""
    best = np.full(len(points), np.inf)
    for a, b in segments:
        along = b - a
        share = np.clip(((points - a) @ along) / max(float(along @ along), 1e-12), 0.0, 1.0)
        best = np.minimum(best, np.hypot(*(points - a - share[:, None] * along).T))
    return best


def inside(shape: Ring, points: Floats) -> npt.NDArray[np.bool_]:
    """Whether points `[N, 2]` lie inside a ring: a ray to the right crosses it an odd number of times."""
    result = np.zeros(len(points), dtype=bool)
    x, y = points.T
    for (ax, ay), (bx, by) in shape.sides:
        if ay != by:
            across = (ay > y) != (by > y)
            result ^= across & (x < ax + (y - ay) * ((bx - ax) / (by - ay)))
    return result


def narrow_gaps(plan: Plan, car: float = 0.36) -> tuple[str, ...]:
    """Remarks on gaps between obstacles that look like passages and are narrower than the car."""
    rings, found = [shape for shape in plan.rings if shape.stops], []
    for k, one in enumerate(rings):
        for other in rings[k + 1 :]:
            gap, (x, y) = nearest_between(one, other)
            if 0.1 < gap < car:
                found.append(f"a gap of {gap:.2f} m near ({x:.2f}, {y:.2f}) is narrower than the car ({car} m)")
    return tuple(found)


def nearest_between(one: Ring, other: Ring) -> tuple[float, Point]:
    """The smallest distance of a corner of one ring from a side of the other, and where that is."""
    best, where = math.inf, (0.0, 0.0)
    for corners, sides in ((one.array, other.sides), (other.array, one.sides)):
        for side in sides:
            apart = away(corners, side[None])
            k = int(apart.argmin())
            if apart[k] < best:
                best, where = float(apart[k]), (float(corners[k, 0]), float(corners[k, 1]))
    return best, where


def check_ring(shape: Ring, arena: str) -> None:
    """Raise `InputError` for a ring that is no polygon."""
    corners = shape.array
    if len(corners) < 3 or not np.isfinite(corners).all() or len(shape.kinds) != len(corners):
        raise InputError(f"arena {arena}: a ring needs three corners or more, all finite, got {shape.points}")
    sides = np.hypot(*(np.roll(corners, -1, 0) - corners).T)
    if sides.min() < 1e-6 or abs(shape.area) < 1e-4:
        raise InputError(f"arena {arena}: walls of no length or a ring of no area near {shape.points[0]}")
    unknown = sorted(set(shape.kinds) - set(KINDS))
    if unknown:
        raise InputError(
            f"arena {arena}: unknown surface {unknown[0]!r}, choose one of {', '.join(KINDS)}"
            f"{did_you_mean(unknown[0], KINDS)}"
        )
    if shape.height is not None and not 0 < shape.height < math.inf:
        raise InputError(f"arena {arena}: heights must be > 0 m, got {shape.height}")
    if not 0 <= shape.bottom < (shape.height or math.inf):
        raise InputError(f"arena {arena}: bottom must be 0 m or more and below the top, got {shape.bottom}")
    crossing = self_crossing(corners)
    if crossing is not None:
        raise InputError(f"arena {arena}: walls cross each other near ({crossing[0]:.2f}, {crossing[1]:.2f})")


def self_crossing(corners: Floats) -> Point | None:
    """Where two walls of a ring cross properly, or None."""
    a, b = corners, np.roll(corners, -1, 0)
    d = b - a
    s, t = crossing(a[:, None], d[:, None], a[None], d[None])
    proper = (s > 1e-6) & (s < 1 - 1e-6) & (t > 1e-6) & (t < 1 - 1e-6)
    if not proper.any():
        return None
    k = int(np.argmax(proper.any(1)))
    place = a[k] + s[k][proper[k]][0] * d[k]
    return float(place[0]), float(place[1])
