"""What the goal controller is about: a place, exploring, the way home; one after the other."""

from __future__ import annotations

import math

import torch
from torch import Tensor

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
    errand = int(state.errand)
    if errand == TO and params.to is not None:
        return reckoned(state.frame, *params.to)
    return reckoned(state.frame, float(state.home[0]), float(state.home[1])) if errand == BACK else None


def reckoned(frame: Tensor, x: float, y: float) -> tuple[float, float]:
    """A place of a frame as dead reckoning counts, m."""
    left, bottom, turned = (float(part) for part in frame)
    cos, sin = math.cos(turned), math.sin(turned)
    return left + cos * x - sin * y, bottom + sin * x + cos * y


def frame_of(pose: Pose, place: Pose) -> Tensor:
    """The frame in which the car is at `place`, where dead reckoning has it at `pose`, `[3]`."""
    x, y, heading, there = (float(part) for part in (*place[:2], pose.heading, place.heading))
    turned = heading - there
    ahead, aside = reckoned(torch.tensor((0.0, 0.0, turned), dtype=torch.float64), x, y)
    return pose.x.new_tensor((float(pose.x) - ahead, float(pose.y) - aside, turned))


def told_place(state: GoalState, pose: Pose, place: Pose | None) -> GoalState:
    """The state of a car that is told where it is, or that it does not know; see `Controller.told_place`.

    Home was kept where dead reckoning had it, and is from now on where the car was told.
    """
    if place is None:
        return state._replace(told=torch.full_like(state.told, -1.0))
    frame, home = frame_of(pose, place), state.home
    if int(state.told) != 1:
        dx, dy = (float(there - here) for there, here in zip(home, frame, strict=False))
        turn_back = torch.stack((frame[0] * 0, frame[1] * 0, -frame[2]))
        home = home.new_tensor(reckoned(turn_back, dx, dy))
    return state._replace(frame=frame, home=home, told=torch.ones_like(state.told))


def finds_nothing(state: GoalState) -> bool:
    """Exploring, the last plan has found no way to anywhere new."""
    return int(state.errand) == EXPLORE and math.isinf(float(state.cost))


def next_errand(
    state: GoalState, here: tuple[float, float, float], errands: list[int], params: GoalParams
) -> GoalState:
    """The errand after this one, when this one is done.

    Exploring is done when for some time no way to anywhere new was found. Once is not enough: at the start no floor
    was seen yet, and beyond a corner that the reactive controller turns around there is more.
    """
    errand, place = int(state.errand), place_of_errand(state, params)
    if errand == DONE:
        return state
    if int(state.told) < 0:
        return state
    arrived = place is not None and math.hypot(place[0] - here[0], place[1] - here[1]) <= params.arrived
    given_up = errand == EXPLORE and float(state.fruitless) >= params.patience
    if not (arrived or given_up):
        return state
    after = errands[errands.index(errand) + 1]
    none = torch.zeros_like(state.due)
    return state._replace(errand=torch.full_like(state.errand, after), due=none, cost=none, fruitless=none)
