"""State of the goal controller, and its tasks one after the other: a goal, exploration, the way home."""

from __future__ import annotations

import math
from typing import NamedTuple

from ndtorch.navigation.controllers.goal.params import GoalParams
from ndtorch.navigation.controllers.ranging._kernels import RangingState
from ndtorch.navigation.local_grid._kernels import Array, LocalGrid
from ndtorch.navigation.odometry import Pose

GOAL, EXPLORE, HOME, DONE = 0, 1, 2, 3
"""Tasks."""

MAX_POINTS = 40
"""Points of a path that are kept: more than its horizon has arcs."""


class GoalState(NamedTuple):
    """State of `GoalControl`.

    Attributes:
        reactive: state of the reactive controller, with its local grid.
        visited: 1 in visited cells; no cells without exploration.
        home: x, y where the drive began, m, in the frame of goals.
        frame: that frame in the frame of dead reckoning: x, y, m, and heading, radians.
        localised: 1 once the pose was corrected, 0 with dead reckoning alone.
        task: `GOAL`, `EXPLORE`, `HOME` or `DONE`.
        path: `[MAX_POINTS, 6]`: x, y, heading, curvature, direction, and speed, m/s.
        points, seen, at: number of its points, and of those before unknown cells; index of the one reached.
        due: time steps until the next plan.
        direction: +1 ahead, -1 backward.
        vetoed: consecutive time steps in which the reactive controller saw no room for the planned path.
        reactive_steps: time steps for which the reactive controller drives alone.
        turn_to: heading to which a differential drive turns on the spot, radians; inf while it does not.
        cost: of the path to the end of the task; inf if there is none.
        fruitless_s: time for which exploration has found no path to a frontier.
        best_cost, visited_before, no_progress_s: exploring, the least cost since the last progress, the number of
            visited cells then, and the time since.
        mode: what the car is doing.
        margin: free and seen distance ahead less the distance in which the commanded speed is braked, m; inf where the
            path is not followed ahead.
    """

    reactive: RangingState
    visited: LocalGrid
    home: tuple[float, float]
    frame: tuple[float, float, float]
    localised: int
    task: int
    path: Array
    points: int
    seen: int
    at: int
    due: int
    direction: float
    vetoed: int
    reactive_steps: int
    turn_to: float
    cost: float
    fruitless_s: float
    best_cost: float
    visited_before: float
    no_progress_s: float
    mode: int
    margin: float


def requested_tasks(params: GoalParams) -> list[int]:
    """The requested tasks in their order; exploration if there is no other."""
    explore = params.explore or not (params.goal or params.return_home)
    wanted = [(GOAL, params.goal is not None), (EXPLORE, explore), (HOME, params.return_home), (DONE, True)]
    return [task for task, given in wanted if given]


def task_goal(state: GoalState, params: GoalParams) -> tuple[float, float] | None:
    """The goal of the task in the frame of dead reckoning; None if it has none."""
    if state.task == GOAL and params.goal is not None:
        return in_odometry(state.frame, *params.goal)
    return in_odometry(state.frame, *state.home) if state.task == HOME else None


def in_odometry(frame: tuple[float, float, float], x: float, y: float) -> tuple[float, float]:
    """A place of a frame in the frame of dead reckoning, m."""
    left, bottom, turned = frame
    cos, sin = math.cos(turned), math.sin(turned)
    return left + cos * x - sin * y, bottom + sin * x + cos * y


def map_frame(pose: Pose, place: Pose) -> tuple[float, float, float]:
    """The frame in which the car is at `place`, while dead reckoning has it at `pose`."""
    turned = pose.heading - place.heading
    ahead, aside = in_odometry((0.0, 0.0, turned), place.x, place.y)
    return pose.x - ahead, pose.y - aside, turned


def with_pose(state: GoalState, pose: Pose, place: Pose) -> GoalState:
    """The state of a car whose pose was corrected; see `Controller.on_pose`.

    Home is kept in the frame of dead reckoning until the first correction, and in that of the map from then on.
    """
    frame, home = map_frame(pose, place), state.home
    if state.localised != 1:
        home = in_odometry((0.0, 0.0, -frame[2]), home[0] - frame[0], home[1] - frame[1])
    return state._replace(frame=frame, home=home, localised=1)


def is_fruitless(state: GoalState) -> bool:
    """Whether exploration has found no path to a frontier."""
    return state.task == EXPLORE and math.isinf(state.cost)


def next_task(state: GoalState, here: tuple[float, float, float], tasks: list[int], params: GoalParams) -> GoalState:
    """The state with the next task, when this one is done.

    Exploration is done when no path to a frontier was found for some time. Once is not enough: at the start no floor
    was seen yet, and beyond a corner that the reactive controller turns around there is more.
    """
    if state.task == DONE:
        return state
    goal = task_goal(state, params)
    arrived = goal is not None and math.hypot(goal[0] - here[0], goal[1] - here[1]) <= params.goal_tolerance_m
    explored = state.task == EXPLORE and state.fruitless_s >= params.exploration_timeout_s
    if not (arrived or explored):
        return state
    after = tasks[tasks.index(state.task) + 1]
    return state._replace(task=after, due=0, cost=0.0, fruitless_s=0.0)
