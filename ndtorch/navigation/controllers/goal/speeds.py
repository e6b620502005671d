"""How fast a way may be driven."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.navigation.controllers.goal.params import GoalParams
from ndtorch.navigation.controllers.goal.planning import Floats, Planned, Surroundings


def allowed_speeds(way: Floats, around: Surroundings, planned: Planned, params: GoalParams) -> Floats:
    """The speed allowed at each place of a way `[n, 5]`, m/s, `[n]`: less where it is tight or was not seen, and no
    more than from which the car can brake to the speed of the place after it."""
    p = params
    speeds = np.full(len(way), p.speed, np.float32)
    for n in range(len(way)):
        x, y, heading, _, direction = (float(v) for v in way[n])
        cos, sin = math.cos(heading), math.sin(heading)
        near = min(float(planned.clear[around.cell_of(x + d * cos, y + d * sin)]) for d in p.way.discs)
        share = (near - p.way.disc - p.way.margin) / (p.way.soft - p.way.disc - p.way.margin)
        speeds[n] = p.slow + (p.speed - p.slow) * min(max(share, 0.0), 1.0) if p.speed > p.slow else p.speed
        bumper = 0.3 * direction
        if planned.unknown[around.cell_of(x + bumper * cos, y + bumper * sin)] > 0:
            speeds[n] = min(speeds[n], p.creep)
        if direction < 0:
            speeds[n] = min(speeds[n], p.reactive.reverse_speed)
    for n in range(len(way) - 2, -1, -1):
        length = math.hypot(*(way[n + 1, :2] - way[n, :2]))
        after = 0.0 if n + 2 < len(way) and way[n + 2, 4] != way[n + 1, 4] else float(speeds[n + 1])
        speeds[n] = min(speeds[n], math.sqrt(after**2 + 2 * p.braking * length))
    return speeds


def speed_towards(way: Floats, at: int, here: tuple[float, float, float], braking: float) -> float:
    """The speed allowed between a place of the way `[n, 6]` and the next one."""
    n = min(at + 1, len(way) - 1)
    length = math.hypot(way[n, 0] - here[0], way[n, 1] - here[1])
    after = 0.0 if n + 1 < len(way) and way[n + 1, 4] != way[n, 4] else float(way[n, 5])
    return max(0.08, min(float(way[max(n - 1, 0), 5]), math.sqrt(after**2 + 2 * braking * length)))
