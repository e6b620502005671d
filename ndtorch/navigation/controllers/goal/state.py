"""What the goal controller remembers."""

from __future__ import annotations

from typing import NamedTuple

from ndtorch.navigation.controllers.ranging._kernels import Array, RangingState
from ndtorch.navigation.local_grid._kernels import LocalGrid

LONGEST = 40
"""Places of a way that are kept: more than its horizon has arcs."""


class GoalState(NamedTuple):
    """State of `GoalControl`, of one car.

    Attributes:
        reactive: of the controller that keeps the last word, with all that is remembered of the surroundings.
        visited: 1 in cells that were passed; no cells where nothing is to be explored.
        home: x, y where the drive began, m, where goals are counted from.
        frame: that frame in dead reckoning's: x, y, m, and heading, radians. It changes as the error of
            dead reckoning becomes known.
        told: 1 once the car was told where it is, -1 while it looks for itself in a known map; 0 is dead reckoning.
        errand: `TO`, `EXPLORE`, `BACK` or `DONE`.
        way: the way that is followed, `[LONGEST, 6]`: x, y, heading, curvature, direction, and the speed that
            is allowed there, m/s; the first `places` of it count.
        places, at: how many places the way has, and the one reached.
        due: time steps until the next plan.
        direction: +1 ahead, -1 backward.
        vetoed: time steps in a row in which the reactive controller saw no room for what was planned.
        lost: time steps for which the reactive controller drives alone.
        cost: of the way to the end of the errand, as last planned; inf where there is none.
        fruitless: seconds for which exploring has found no way to anywhere new.
        best, passed, tried: exploring, the least cost since the car last came nearer to something new, how many cells
            it had passed then, and seconds since.
        mode: what the car is doing.
    """

    reactive: RangingState
    visited: LocalGrid
    home: tuple[float, float]
    frame: tuple[float, float, float]
    told: int
    errand: int
    way: Array
    places: int
    at: int
    due: int
    direction: float
    vetoed: int
    lost: int
    cost: float
    fruitless: float
    best: float
    passed: float
    tried: float
    mode: int
