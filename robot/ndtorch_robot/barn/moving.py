"""Cylinders that move to and fro between those of a world, and whether a car could see them."""

from __future__ import annotations

import math

import numpy as np

from ndtorch_robot.barn.worlds import AROUND, World
from ndtorch_robot.sim.model import MOVING_RADIUS
from ndtorch_robot.sim.plan import Floats, Point
from ndtorch_robot.sim.simulation import Mover

SPEEDS, CURVATURES = (0.2, 0.8), (0.2, 0.6)
"""m/s, and 1/m of the half of the paths that turn."""

LONGEST, SHORTEST, STEP = 3.0, 0.75, 0.05
"""A path leads this far to both sides of the place where it meets the car, m, or as far as it is free; less than the
second is not taken where there is more. Its points are a step apart."""

EXPECTED = 0.8
"""m/s of the car along the line from start to goal, by which a cylinder is there at the same time."""

VIEW_M = 4.0
"""A cylinder farther than this is not counted as visible."""


def moving_cylinders(world: World, count: int, seed: int) -> tuple[Mover, ...]:
    """Cylinders that meet the car on its line to the goal: by turns from ahead, from beside and from behind.

    The paths are straight or turn. They end at what stands, and never lead within 1.5 m of the start.
    """
    rng = np.random.default_rng((seed, world.number, 400))
    start, goal = np.array(world.start[:2]), np.array(world.goal)
    length, along = float(np.hypot(*(goal - start))), math.atan2(goal[1] - start[1], goal[0] - start[0])
    made = []
    for k in range(count):
        best: tuple[float, Mover] | None = None
        for _ in range(100):
            share = float(rng.uniform(0.25, 0.85))
            aside = float(rng.uniform(-0.5, 0.5))
            met = start + share * (goal - start) + aside * np.array((-math.sin(along), math.cos(along)))
            side = float(rng.choice((-1, 1)))
            heading = along + (math.pi, side * math.pi / 2, 0.0)[k % 3] + float(rng.uniform(-0.5, 0.5))
            bend = side * float(rng.uniform(*CURVATURES)) if rng.random() < 0.5 else 0.0
            speed, late = float(rng.uniform(*SPEEDS)), float(rng.uniform(-1.0, 1.0))
            before, after = (arc(world, met, heading, bend, way) for way in (-1, 1))
            least = min(len(before), len(after)) * STEP
            points = np.concatenate((before[::-1], met[None], after))
            when = share * length / EXPECTED + late
            mover = Mover(tuple(map(tuple, points.tolist())), speed, len(before) * STEP - speed * when)
            if len(points) > 1 and (best is None or least > best[0]):
                best = (least, mover)
            if least >= SHORTEST:
                break
        assert best is not None
        made.append(best[1])
    return tuple(made)


def arc(world: World, met: Floats, heading: float, bend: float, way: int) -> Floats:
    """Points of the arc from a place, forward or backward, up to the first that is not free, `[n, 2]`."""
    s = way * STEP * np.arange(1, round(LONGEST / STEP) + 1)
    turned = heading + bend * s / 2
    points: Floats = met + (s * np.sinc(bend * s / 2 / math.pi))[:, None] * np.stack(
        (np.cos(turned), np.sin(turned)), 1
    )
    stand, (left, right, bottom, top) = np.array(world.cylinders), world.bounds
    inside = np.array([(left + AROUND / 2, bottom + AROUND / 2), (right - AROUND / 2, top - AROUND / 2)])
    free = np.hypot(*(points[:, None] - stand).transpose(2, 0, 1)).min(1) > world.radius + MOVING_RADIUS
    free &= np.hypot(*(points - np.array(world.start[:2])).T) > 1.5
    free &= ((points > inside[0]) & (points < inside[1])).all(1)
    return points[: len(points) if free.all() else int(free.argmin())]


def is_visible(world: World, place: Point, camera: Point, heading: float, half_view: float) -> bool:
    """Whether a cylinder at a place is in the view of a camera, `half_view` radians to both sides, and nothing that
    stands hides its middle."""
    away = np.array(place) - np.array(camera)
    distance, bearing = float(np.hypot(*away)), math.atan2(away[1], away[0]) - heading
    if distance > VIEW_M or abs(math.remainder(bearing, 2 * math.pi)) > half_view:
        return False
    to = np.array(world.cylinders) - np.array(camera)
    share = np.clip(to @ away / distance**2, 0.0, 1.0)
    return bool((np.hypot(*(to - share[:, None] * away).T) > world.radius).all())


class Sightings:
    """Which moving cylinders were visible in each of the last two seconds."""

    def __init__(self, rate: float) -> None:
        self.rate, self.kept = rate, round(2 * rate)
        self.frames: list[tuple[bool, ...]] = []

    def add(self, visible: tuple[bool, ...]) -> None:
        self.frames = [*self.frames, visible][-self.kept :]

    def lasted(self, cylinder: int) -> bool:
        """Whether the cylinder was visible for a second without a break."""
        run = longest = 0
        for frame in self.frames:
            run = run + 1 if frame[cylinder] else 0
            longest = max(longest, run)
        return longest >= round(self.rate)
