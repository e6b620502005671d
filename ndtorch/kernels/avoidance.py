"""The state machine of the published controller."""

from __future__ import annotations

import math

Numbers = tuple[float, ...]


def avoidance(left: float, right: float, state: Numbers, constants: Numbers) -> tuple[float, float, Numbers]:
    """`avoidance_step` of one car: speed, curvature, and the new state.

    Args:
        state: of `AvoidanceState`.
        constants: of `AvoidanceConstants`.
    """
    share, turn_threshold, high_threshold, low_threshold, normal, tight, turn_steps, watching, speed = constants[:9]
    difference, age, curvature = state
    now = right - left
    difference += share * (now - difference)
    age = age + 1
    cruising = age >= watching
    high = min(left, right) > high_threshold
    stop = cruising and max(left, right) < low_threshold
    turn = cruising and not stop and (high or abs(difference) > turn_threshold)
    if turn:
        curvature = math.copysign(tight, now) if high else math.copysign(normal, difference)
        age = 0.0
    elif age >= turn_steps or age != age:
        curvature = 0.0
    if stop:
        age = -math.inf
    return (speed if age > -math.inf else 0.0), curvature, (difference, age, curvature)
