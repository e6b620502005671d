"""What the goal controller is about: a place, exploring, the way home; one after the other."""

from __future__ import annotations

import math

import torch

from ndtorch.navigation.controllers.goal.params import GoalParams
from ndtorch.navigation.controllers.goal.state import GoalState

TO, EXPLORE, BACK, DONE = 0, 1, 2, 3
"""Errands; those that were not asked for are left out."""


def asked(params: GoalParams) -> list[int]:
    """The errands in their order; without any other the car explores."""
    explore = params.explore or not (params.to or params.back)
    wanted = [(TO, params.to is not None), (EXPLORE, explore), (BACK, params.back), (DONE, True)]
    return [errand for errand, given in wanted if given]


def place_of_errand(state: GoalState, params: GoalParams) -> tuple[float, float] | None:
    """Where the errand ends, if that is one place."""
    errand = int(state.errand)
    if errand == TO:
        return params.to
    return (float(state.home[0]), float(state.home[1])) if errand == BACK else None


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
    arrived = place is not None and math.hypot(place[0] - here[0], place[1] - here[1]) <= params.arrived
    given_up = errand == EXPLORE and float(state.fruitless) >= params.patience
    if not (arrived or given_up):
        return state
    after = errands[errands.index(errand) + 1]
    none = torch.zeros_like(state.due)
    return state._replace(errand=torch.full_like(state.errand, after), due=none, cost=none, fruitless=none)
