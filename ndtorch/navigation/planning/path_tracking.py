"""Tracking of a planned path: pure pursuit, and the speed at each of its points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.navigation.planning._kernels import Floats
from ndtorch.navigation.planning.costmap import LocalMap
from ndtorch.navigation.planning.params import PlannerParams
from ndtorch.navigation.planning.planner import Plan

MIN_SPEED = 0.08
"""m/s: a car that tracks a path is not slower."""


class Pursuit(NamedTuple):
    """How to drive to stay on a path.

    Attributes:
        direction: +1 ahead, -1 backward, 0 where the path has ended.
        curvature: 1/m.
        at: index of the point of the path that the car has reached.
        left: metres left of the stretch in this direction.
    """

    direction: float
    curvature: float
    at: int
    left: float


def pure_pursuit(
    path: Floats, at: int, pose: tuple[float, float, float], lookahead: float, max_curvature: float
) -> Pursuit:
    """Pursue a point of the path some distance ahead, on the stretch that has one direction.

    Args:
        path: of `Plan`.
        at: index of the point reached before.
        pose: x, y, heading of the car.
        lookahead: distance of the point, m.
        max_curvature: 1/m.
    """
    x, y, heading = pose
    last = len(path) - 1
    while True:
        if at >= last:
            return Pursuit(0.0, 0.0, at, 0.0)
        direction = float(path[at + 1, 4])
        end = at + 1
        while end < last and path[end + 1, 4] == direction:
            end += 1
        # The point reached: the last one whose line across the path lies behind the car.
        while at < end:
            dx, dy = x - path[at + 1, 0], y - path[at + 1, 1]
            if direction * (dx * math.cos(path[at + 1, 2]) + dy * math.sin(path[at + 1, 2])) < -0.02:
                break
            at += 1
        if at < end or end == last:
            break
    if at >= end:
        return Pursuit(0.0, 0.0, at, 0.0)
    steps = np.hypot(*(np.diff(path[at + 1 : end + 1, :2], axis=0)).T) if end > at + 1 else np.zeros(0)
    first = math.hypot(path[at + 1, 0] - x, path[at + 1, 1] - y)
    left = first + float(steps.sum())
    # Along the path by `lookahead`; beyond the end of the stretch straight on.
    k, far = at + 1, first
    while far < lookahead and k < end:
        far += float(steps[k - at - 1])
        k += 1
    over = far - lookahead
    tx, ty, th = (float(v) for v in path[k, :3])
    if over > 0:
        before = (float(path[k - 1, 0]), float(path[k - 1, 1])) if k > at + 1 else (x, y)
        length = math.hypot(tx - before[0], ty - before[1])
        share = min(1.0, over / max(length, 1e-6))
        tx, ty = tx + share * (before[0] - tx), ty + share * (before[1] - ty)
    else:
        tx, ty = tx - over * direction * math.cos(th), ty - over * direction * math.sin(th)
    dx, dy = tx - x, ty - y
    aside = -math.sin(heading) * dx + math.cos(heading) * dy
    square = max(dx * dx + dy * dy, 1e-4)
    curvature = min(max(2 * aside / square, -max_curvature), max_curvature)
    return Pursuit(direction, curvature, at, left)


class SpeedLimits(NamedTuple):
    """Speeds where there is room, where it is tight, and backward, m/s, and deceleration, m/s^2."""

    cruise: float
    tight: float
    reverse: float
    deceleration: float


def speed_profile(plan: Plan, local_map: LocalMap, limits: SpeedLimits, params: PlannerParams) -> Floats:
    """The speed at each point of a path, m/s, `[n]`: lower where it is tight, and no higher than from where the car can
    brake to the speed of the next point."""
    p, path = params, plan.path
    speeds = np.full(len(path), limits.cruise, np.float32)
    for n in range(len(path)):
        x, y, heading, _, direction = (float(v) for v in path[n])
        cos, sin = math.cos(heading), math.sin(heading)
        clear = min(float(plan.clear[local_map.cell_of(x + d * cos, y + d * sin)]) for d in p.footprint_centers_m)
        share = (clear - p.min_clearance_m) / (p.inflation_radius_m - p.min_clearance_m)
        if limits.cruise > limits.tight:
            speeds[n] = limits.tight + (limits.cruise - limits.tight) * min(max(share, 0.0), 1.0)
        if direction < 0:
            speeds[n] = min(speeds[n], limits.reverse)
    for n in range(len(path) - 2, -1, -1):
        length = math.hypot(*(path[n + 1, :2] - path[n, :2]))
        after = 0.0 if n + 2 < len(path) and path[n + 2, 4] != path[n + 1, 4] else float(speeds[n + 1])
        speeds[n] = min(speeds[n], math.sqrt(after**2 + 2 * limits.deceleration * length))
    return speeds


def seen_points(plan: Plan, local_map: LocalMap, params: PlannerParams) -> int:
    """How many points of a path come before the first at which the leading disc of the footprint is over unknown
    cells."""
    for n, (x, y, heading, _, direction) in enumerate(plan.path.tolist()):
        nose = max(direction * d for d in params.footprint_centers_m) * direction
        if plan.unseen[local_map.cell_of(x + nose * math.cos(heading), y + nose * math.sin(heading))] > 0:
            return n
    return len(plan.path)


def seen_length(path: Floats, at: int, seen: int, here: tuple[float, float, float]) -> float:
    """Metres along a path `[n, 6]` from the car, which has reached the point `at`, to the last of the `seen_points`;
    inf where these are all."""
    if seen == len(path):
        return math.inf
    points = np.vstack((here[:2], path[at + 1 : seen, :2]))
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def speed_towards(path: Floats, at: int, here: tuple[float, float, float], deceleration: float) -> float:
    """The speed between a point of the path `[n, 6]`, whose last column is the speed, and the next one."""
    n = min(at + 1, len(path) - 1)
    length = math.hypot(path[n, 0] - here[0], path[n, 1] - here[1])
    after = 0.0 if n + 1 < len(path) and path[n + 1, 4] != path[n, 4] else float(path[n, 5])
    return max(MIN_SPEED, min(float(path[max(n - 1, 0), 5]), math.sqrt(after**2 + 2 * deceleration * length)))
