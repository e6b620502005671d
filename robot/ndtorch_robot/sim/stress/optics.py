"""Optics and shutter: where a camera really looks, and where the car was when each row was read."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from ndtorch.navigation import Rect
from ndtorch_robot.sim.stress.options import Stress

Direction = tuple[float, float, float]

SAMPLES = 4
"""Pictures of which a blurred one is the mean."""

SLICE = 12
"""Rows that are drawn as if read at one time."""


class Motion(NamedTuple):
    """What the car does while the shutter is open: m/s and 1/m."""

    speed: float = 0.0
    curvature: float = 0.0


def axes(heading: float, side: int, stress: Stress) -> tuple[Direction, Direction]:
    """Directions in which a camera looks and which it holds for up.

    Args:
        side: 0 the left one, 1 the right one.
    """
    turn = heading + math.radians(stress.yaw + side * stress.turned)
    pitch, roll = math.radians(stress.pitch), math.radians(stress.roll)
    ahead, left = (math.cos(turn), math.sin(turn), 0.0), (-math.sin(turn), math.cos(turn), 0.0)
    forward = (math.cos(pitch) * ahead[0], math.cos(pitch) * ahead[1], -math.sin(pitch))
    upward = (math.sin(pitch) * ahead[0], math.sin(pitch) * ahead[1], math.cos(pitch))
    # Turned to its right side, the camera's up leans to the right.
    x, y, z = (math.cos(roll) * u - math.sin(roll) * w for u, w in zip(upward, left, strict=True))
    return forward, (x, y, z)


def moved(x: float, y: float, heading: float, motion: Motion, seconds: float) -> tuple[float, float, float]:
    """The pose so many seconds later, or earlier."""
    length = motion.speed * seconds
    turned = motion.curvature * length
    half = turned / 2
    return x + length * math.cos(heading + half), y + length * math.sin(heading + half), heading + turned


def shutter_times(stress: Stress) -> list[float]:
    """Times of the pictures of which one is made, s before the shutter closes."""
    return [0.0] if not stress.blur else [-stress.blur * (k + 0.5) / SAMPLES for k in range(SAMPLES)]


def slices(rect: Rect, stress: Stress, height: int) -> Iterator[tuple[Rect, float]]:
    """Parts of a rectangle, and when each is read, s from the middle of the frame."""
    step = SLICE if stress.rolling else rect.bottom - rect.top
    for top in range(rect.top, rect.bottom, step):
        part = rect._replace(top=top, bottom=min(top + step, rect.bottom))
        yield part, stress.rolling * ((part.top + part.bottom) / 2 / height - 0.5)
