"""Where a car is after it has driven an arc."""

from __future__ import annotations

import math


def arc(x: float, y: float, heading: float, speed: float, curvature: float, dt: float) -> tuple[float, float, float]:
    """`drive_step` of one car in plain numbers."""
    length = speed * dt
    half = curvature * length / 2
    chord = length * (math.sin(half) / half if half != 0 else 1.0)
    direction = heading + half
    return x + chord * math.cos(direction), y + chord * math.sin(direction), direction + half
