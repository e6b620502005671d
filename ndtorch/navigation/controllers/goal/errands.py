"""What the goal controller is about: a place, exploring, the way home; one after the other."""

from __future__ import annotations

import math

from ndtorch.navigation.controllers.goal.params import GoalParams
from ndtorch.navigation.controllers.goal.state import GoalState
from ndtorch.navigation.odometry import Pose

TO, EXPLORE, BACK, DONE = 0, 1, 2, 3
"""Errands; those that were not asked for are left out."""


def asked(params: GoalParams) -> list[int]:
    """The errands in their order; without any other the car explores."""
    explore = params.explore or not (params.to or params.back)
    wanted = [(TO, params.to is not None), (EXPLORE, explore), (BACK, params.back), (DONE, True)]
    return [errand for errand, given in wanted if given]


def place_of_errand(state: GoalState, params: GoalParams) -> tuple[float, float] | None:
    """Where the errand ends as dead reckoning counts, if that is one place."""
    errand = state.errand
    if errand == TO and params.to is not None:
        return reckoned(state.frame, *params.to)
    return reckoned(state.frame, *state.home) if errand == BACK else None


def reckoned(frame: tuple[float, float, float], x: float, y: float) -> tuple[float, float]:
    """A place of a frame as dead reckoning counts, m."""
    left, bottom, turned = frame
    cos, sin = math.cos(turned), math.sin(turned)
    return left + cos * x - sin * y, bottom + sin * x + cos * y


def frame_of(pose: Pose, place: Pose) -> tuple[float, float, float]:
    """The frame in which the car is at `place`, where dead reckoning has it at `pose`."""
    turned = pose.heading - place.heading
    ahead, aside = reckoned((0.0, 0.0, turned), place.x, place.y)
    return pose.x - ahead, pose.y - aside, turned


def with_pose(state: GoalState, pose: Pose, place: Pose | None) -> GoalState:
    """The state of a car that is told where it is, or that it does not know; see `Controller.on_pose`.

    Home was kept where dead reckoning had it, and is from now on where the car was told.
    """
    if place is None:
        return state._replace(told=-1)
    frame, home = frame_of(pose, place), state.home
    if state.told != 1:
        home = reckoned((0.0, 0.0, -frame[2]), home[0] - frame[0], home[1] - frame[1])
    return state._replace(frame=frame, home=home, told=1)


def finds_nothing(state: GoalState) -> bool:
    """Exploring, the last plan has found no way to anywhere new."""
    return state.errand == EXPLORE and math.isinf(state.cost)


def next_errand(
    state: GoalState, here: tuple[float, float, float], errands: list[int], params: GoalParams
) -> GoalState:
    """The errand after this one, when this one is done.

    Exploring is done when for some time no way to anywhere new was found. Once is not enough: at the start no floor
    was seen yet, and beyond a corner that the reactive controller turns around there is more.
    """
    errand, place = state.errand, place_of_errand(state, params)
    if errand == DONE:
        return state
    if state.told < 0:
        return state
    arrived = place is not None and math.hypot(place[0] - here[0], place[1] - here[1]) <= params.arrived
    given_up = errand == EXPLORE and state.fruitless >= params.patience
    if not (arrived or given_up):
        return state
    after = errands[errands.index(errand) + 1]
    return state._replace(errand=after, due=0, cost=0.0, fruitless=0.0)
