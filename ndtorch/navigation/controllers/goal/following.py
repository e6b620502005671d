"""Driving along a planned way: where to aim and how fast."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float32]


class Aim(NamedTuple):
    """What to drive to stay on a way.

    Attributes:
        direction: +1 ahead, -1 backward, 0 where the way has ended.
        curvature: 1/m.
        at: number of the place of the way that the car has reached.
        left: metres left of the stretch in this direction.
    """

    direction: float
    curvature: float
    at: int
    left: float


def follow(way: Floats, at: int, pose: tuple[float, float, float], ahead: float, tightest: float) -> Aim:
    """Aim at a place of the way some distance ahead (pure pursuit), on the stretch that has one direction.

    Args:
        way: `[n, 5]`, see `planning.Planned`.
        at: place reached before.
        pose: x, y, heading of the car.
        ahead: distance of the place to aim at, m.
        tightest: largest curvature, 1/m.
    """
    x, y, heading = pose
    last = len(way) - 1
    while True:
        if at >= last:
            return Aim(0.0, 0.0, at, 0.0)
        direction = float(way[at + 1, 4])
        end = at + 1
        while end < last and way[end + 1, 4] == direction:
            end += 1
        # The place reached: the last one whose line across the way lies behind the car.
        while at < end:
            dx, dy = x - way[at + 1, 0], y - way[at + 1, 1]
            if direction * (dx * math.cos(way[at + 1, 2]) + dy * math.sin(way[at + 1, 2])) < -0.02:
                break
            at += 1
        if at < end or end == last:
            break
    if at >= end:
        return Aim(0.0, 0.0, at, 0.0)
    steps = np.hypot(*(np.diff(way[at + 1 : end + 1, :2], axis=0)).T) if end > at + 1 else np.zeros(0)
    first = math.hypot(way[at + 1, 0] - x, way[at + 1, 1] - y)
    left = first + float(steps.sum())
    # Along the way by `ahead`; beyond the end of the stretch straight on.
    reach, k, far = ahead, at + 1, first
    while far < reach and k < end:
        far += float(steps[k - at - 1])
        k += 1
    over = far - reach
    tx, ty, th = (float(v) for v in way[k, :3])
    if over > 0:
        before = (float(way[k - 1, 0]), float(way[k - 1, 1])) if k > at + 1 else (x, y)
        length = math.hypot(tx - before[0], ty - before[1])
        share = min(1.0, over / max(length, 1e-6))
        tx, ty = tx + share * (before[0] - tx), ty + share * (before[1] - ty)
    else:
        tx, ty = tx - over * direction * math.cos(th), ty - over * direction * math.sin(th)
    dx, dy = tx - x, ty - y
    aside = -math.sin(heading) * dx + math.cos(heading) * dy
    square = max(dx * dx + dy * dy, 1e-4)
    curvature = min(max(2 * aside / square, -tightest), tightest)
    return Aim(direction, curvature, at, left)
