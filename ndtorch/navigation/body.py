"""The body of a robot, from which the lengths of everything that drives it follow."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from ndtorch.arguments import check_numbers

SPOT_RADIUS = 0.05  # radius of a turn on the spot, in units of the body: commands are speed and curvature

CRUISE_SPEED, STOPPING_M = 0.5, 0.1
"""The car of [A] drives at the first, m/s, and stops within the second, m: its reaction and its braking."""


@dataclass(frozen=True)
class Body:
    """The body of a robot: a rectangle about the point that it turns about.

    Controllers keep their lengths in units of the body: the car of [A] is the unit, and a body of half its size turns,
    stops and looks at half its distances, at half its speed. So what holds for one robot holds for one of any size in a
    world of its size.

    Args:
        length_m: Length of the body.
        width_m: Width of the body.
        min_turn_radius_m: Radius of the tightest turn; 0 for a differential drive, which turns on the spot.
        max_speed_m_per_s: Highest speed.
        max_acceleration_m_per_s2: Highest change of speed.
        reaction_s: Time from a command until the robot obeys.

    >>> Body(0.25, 0.18, 0.2).unit_m
    0.5
    """

    length_m: float = 0.5
    width_m: float = 0.36
    min_turn_radius_m: float = 0.45
    max_speed_m_per_s: float = 1.0
    max_acceleration_m_per_s2: float = 2.5
    reaction_s: float = 0.1

    def __post_init__(self) -> None:
        check_numbers(self, positive=("length_m", "width_m", "max_speed_m_per_s", "max_acceleration_m_per_s2"))

    @property
    def spins(self) -> bool:
        return self.min_turn_radius_m == 0

    @property
    def size_m(self) -> float:
        """Metres for each metre of the car of [A], by length and width alone: how near things must be seen."""
        return max(self.length_m / Body.length_m, self.width_m / Body.width_m)

    @property
    def unit_m(self) -> float:
        """Metres for each metre of the controllers' parameters: 1 for the car of [A]."""
        return max(self.size_m, self.min_turn_radius_m / Body.min_turn_radius_m)

    @property
    def max_curvature_per_m(self) -> float:
        """Curvature of the tightest turn; of that on the spot by `SPOT_RADIUS`."""
        return 1 / (self.min_turn_radius_m or SPOT_RADIUS * self.unit_m)

    @property
    def cruise_m_per_s(self) -> float:
        """Speed at which it stops within the length in which the car of [A] does, in units of its body."""
        unit = self.unit_m
        stopping = braking_speed(STOPPING_M * unit, self.max_acceleration_m_per_s2, self.reaction_s)
        return min(CRUISE_SPEED * unit, stopping, self.max_speed_m_per_s)

    @property
    def speed_ratio(self) -> float:
        """`cruise_m_per_s` over the speed of the car of [A], in units of the body; at most 1."""
        return min(1.0, round(self.cruise_m_per_s / (CRUISE_SPEED * self.unit_m), 9))

    def in_units(self) -> Body:
        """The body in its own units, in which controllers work."""
        lengths = {name: value / self.unit_m for name, value in vars(self).items() if name != "reaction_s"}
        return replace(self, **lengths)


def braking_speed(free: float, deceleration: float, reaction: float) -> float:
    """The speed v, m/s, whose stopping distance v * reaction + v^2 / (2 * deceleration) is `free`, m."""
    lag = deceleration * reaction
    return math.sqrt(lag * lag + 2 * deceleration * max(0.0, free)) - lag


def params_for_body(params: Any, body: Body) -> Any:
    """Parameters of a controller in units of the body: its outline, speeds at which it can stop, and the goal."""
    changed: dict[str, Any] = {}
    for name, value in vars(params).items():
        if isinstance(value, Body):
            changed[name] = body.in_units()
        elif name == "goal" and value is not None:
            changed[name] = tuple(part / body.unit_m for part in value)
        elif name.endswith("m_per_s"):
            changed[name] = value * body.speed_ratio
    return replace(params, **changed)
