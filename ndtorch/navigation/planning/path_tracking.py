"""Tracking of a planned path by pure pursuit."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.navigation.planning._kernels import Floats

MIN_SPEED = 0.08
"""m/s: a car that tracks a path is not slower."""

REACHED_M = 0.02
"""A point of the path is reached this far before the line across the path through it."""


class Pursuit(NamedTuple):
    """How to drive to stay on a path.

    Attributes:
        direction: +1 ahead, -1 backward, 0 where the path has ended.
        curvature: 1/m.
        at: index of the point of the path that the car has reached.
    """

    direction: float
    curvature: float
    at: int


def pure_pursuit(
    path: Floats, at: int, pose: tuple[float, float, float], lookahead: float, max_curvature: float
) -> Pursuit:
    """Pursue a point of the path some distance ahead, on the stretch that has one direction [Coulter 1992].

    Args:
        path: of `Plan`.
        at: index of the point reached before.
        pose: x, y, heading of the car.
        lookahead: distance of the point along the path, m; beyond the end of the stretch straight on.
        max_curvature: 1/m.
    """
    x, y, heading = pose
    while at + 1 < len(path):
        dx, dy, turned, direction = x - path[at + 1, 0], y - path[at + 1, 1], path[at + 1, 2], path[at + 1, 4]
        if direction * (dx * math.cos(turned) + dy * math.sin(turned)) < -REACHED_M:
            break
        at += 1
    if at + 1 >= len(path):
        return Pursuit(0.0, 0.0, at)
    direction = float(path[at + 1, 4])
    others = np.flatnonzero(path[at + 1 :, 4] != direction)
    stretch = path[at + 1 : at + 1 + others[0] if len(others) else None]
    end_x, end_y, turned = stretch[-1, :3].tolist()
    beyond = end_x + direction * lookahead * math.cos(turned), end_y + direction * lookahead * math.sin(turned)
    points = np.vstack(((x, y), stretch[:, :2], beyond))
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    dx, dy = np.interp(lookahead, along, points[:, 0]) - x, np.interp(lookahead, along, points[:, 1]) - y
    aside = math.cos(heading) * dy - math.sin(heading) * dx
    curvature = 2 * aside / max(dx * dx + dy * dy, 1e-4)
    return Pursuit(direction, float(min(max(curvature, -max_curvature), max_curvature)), at)


def tracking_speed(path: Floats, at: int, pose: tuple[float, float, float], deceleration: float) -> float:
    """The speed between a point of the path and the next one: what can be braked to the speed there, m/s."""
    end = path[at + 1].tolist()
    braked = math.sqrt(end[5] ** 2 + 2 * deceleration * math.hypot(end[0] - pose[0], end[1] - pose[1]))
    return float(max(MIN_SPEED, min(max(float(path[at, 5]), end[5]), braked)))
