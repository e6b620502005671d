"""The tasks of the goal controller, one after the other: a goal, exploration, the way home."""

from __future__ import annotations

import math

from ndtorch.navigation.controllers.goal.params import GoalParams
from ndtorch.navigation.controllers.goal.state import GoalState
from ndtorch.navigation.odometry import Pose

GOAL, EXPLORE, HOME, DONE = 0, 1, 2, 3
"""Tasks."""


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


def with_pose(state: GoalState, pose: Pose, place: Pose | None) -> GoalState:
    """The state of a car whose pose was corrected, or is unknown; see `Controller.on_pose`.

    Home is kept in the frame of dead reckoning until the first correction, and in that of the map from then on.
    """
    if place is None:
        return state._replace(localised=-1)
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
    if state.task == DONE or state.localised < 0:
        return state
    goal = task_goal(state, params)
    arrived = goal is not None and math.hypot(goal[0] - here[0], goal[1] - here[1]) <= params.goal_tolerance_m
    explored = state.task == EXPLORE and state.fruitless_s >= params.exploration_timeout_s
    if not (arrived or explored):
        return state
    after = tasks[tasks.index(state.task) + 1]
    return state._replace(task=after, due=0, cost=0.0, fruitless_s=0.0)
