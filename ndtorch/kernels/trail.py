"""Where one car has just driven, and how it goes back there."""

from __future__ import annotations

import math
from typing import Any

Array = Any

SPACING = 0.05
"""Metres from one pose of the trail to the next."""

POSES = 70
"""How many are kept: 3.5 m."""

AHEAD = 4
"""The car that goes back steers towards the pose so many behind the last."""

ASIDE, TURNED = 0.06, 0.25
"""A car that backs farther beside the trail than this, in m, or is turned more against it, in radians, has left it."""

HERE = 0.01
"""Metres before which a pose is passed; and twice that is too near to steer towards."""

NEAREST = 0.01
"""The square of the nearest distance, m^2, for which a curvature is worked out."""


def lay_trail(trail: Array, count: float, pose: tuple[float, float, float], speed: float, after: Array) -> float:
    """`lay` into `after`, `[poses, 3]`; returns how many poses are on the trail then."""
    kind, poses = trail.dtype.type, trail.shape[0]
    here = (kind(pose[0]), kind(pose[1]), kind(pose[2]))
    cos, sin = math.cos(here[2]), math.sin(here[2])
    ahead, aside = trail[0, 0] - here[0], trail[0, 1] - here[1]
    x, y = cos * ahead + sin * aside, cos * aside - sin * ahead
    first = count < 1
    turned = abs(trail[0, 2] - here[2]) > kind(TURNED)
    off = not first and speed < kind(-1e-3) and (abs(y) > kind(ASIDE) or turned)
    passed = not first and not off and speed <= 0 and x > kind(-HERE)
    far = not first and speed > 0 and math.hypot(x, y) >= kind(SPACING)
    shift = 1 if first or off or far else -1 if passed else 0
    for n in range(poses):
        for k in range(3):
            after[n, k] = trail[min(max(n - shift, 0), poses - 1), k]
    if shift == 1:
        after[0, 0], after[0, 1], after[0, 2] = here
    return 1.0 if first or off else min(count + shift, float(poses))


def follow_trail(trail: Array, count: float, pose: tuple[float, float, float], tightest: float) -> tuple[float, float]:
    """`back`: how far the trail leads back, m, and the curvature that follows it."""
    kind = trail.dtype.type
    at = int(min(max(count - 1, 0), AHEAD))
    cos, sin = math.cos(kind(pose[2])), math.sin(kind(pose[2]))
    ahead, aside = trail[at, 0] - kind(pose[0]), trail[at, 1] - kind(pose[1])
    x, y = cos * ahead + sin * aside, cos * aside - sin * ahead
    bend = kind(2) * y / max(x * x + y * y, kind(NEAREST))
    bend = min(max(bend, kind(-tightest)), kind(tightest))
    return float(kind(max(count - 1, 0)) * kind(SPACING)), float(bend) if x < kind(-2 * HERE) else 0.0
