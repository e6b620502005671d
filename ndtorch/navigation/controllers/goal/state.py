"""State of the goal controller."""

from __future__ import annotations

from typing import NamedTuple

from ndtorch.navigation.controllers.ranging._kernels import Array, RangingState
from ndtorch.navigation.local_grid._kernels import LocalGrid

MAX_POINTS = 40
"""Points of a path that are kept: more than its horizon has arcs."""


class GoalState(NamedTuple):
    """State of `GoalControl`.

    Attributes:
        reactive: state of the reactive controller, with its local grid.
        visited: 1 in visited cells; no cells without exploration.
        home: x, y where the drive began, m, in the frame of goals.
        frame: that frame in the frame of dead reckoning: x, y, m, and heading, radians.
        localised: 1 once the pose was corrected, -1 during relocalisation, 0 with dead reckoning alone.
        task: `GOAL`, `EXPLORE`, `HOME` or `DONE`.
        path: `[MAX_POINTS, 6]`: x, y, heading, curvature, direction, and speed, m/s.
        points, at: number of its points, and index of the one reached.
        due: time steps until the next plan.
        direction: +1 ahead, -1 backward.
        vetoed: consecutive time steps in which the reactive controller saw no room for the planned path.
        reactive_steps: time steps for which the reactive controller drives alone.
        cost: of the path to the end of the task; inf if there is none.
        fruitless_s: time for which exploration has found no path to a frontier.
        best_cost, visited_before, no_progress_s: exploring, the least cost since the last progress, the number of
            visited cells then, and the time since.
        mode: what the car is doing.
    """

    reactive: RangingState
    visited: LocalGrid
    home: tuple[float, float]
    frame: tuple[float, float, float]
    localised: int
    task: int
    path: Array
    points: int
    at: int
    due: int
    direction: float
    vetoed: int
    reactive_steps: int
    cost: float
    fruitless_s: float
    best_cost: float
    visited_before: float
    no_progress_s: float
    mode: int
