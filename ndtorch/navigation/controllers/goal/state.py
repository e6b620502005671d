"""What the goal controller remembers, and the states of a batch one by one."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor

from ndtorch.navigation.controllers.ranging.decision import RangingState
from ndtorch.navigation.controllers.ranging.patch import Patch

LONGEST = 40
"""Places of a way that are kept: more than its horizon has arcs."""


class GoalState(NamedTuple):
    """State of `GoalControl`, `[...]` where nothing else is said.

    Attributes:
        reactive: of the controller that keeps the last word, with all that is remembered of the surroundings.
        visited: 1 in cells that were passed; no cells where nothing is to be explored.
        home: x, y where the drive began, `[..., 2]`, m, where goals are counted from.
        frame: that frame in dead reckoning's: x, y, m, and heading, radians, `[..., 3]`. It changes as the error of
            dead reckoning becomes known.
        told: 1 once the car was told where it is, -1 while it looks for itself in a known map; 0 is dead reckoning.
        errand: `TO`, `EXPLORE`, `BACK` or `DONE`.
        way: the way that is followed, `[..., LONGEST, 6]`: x, y, heading, curvature, direction, and the speed that
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
    visited: Patch
    home: Tensor
    frame: Tensor
    told: Tensor
    errand: Tensor
    way: Tensor
    places: Tensor
    at: Tensor
    due: Tensor
    direction: Tensor
    vetoed: Tensor
    lost: Tensor
    cost: Tensor
    fruitless: Tensor
    best: Tensor
    passed: Tensor
    tried: Tensor
    mode: Tensor


def take(state: Any, n: int, dims: int) -> Any:
    """The state of one of a batch."""
    if isinstance(state, Tensor):
        return state.flatten(0, dims - 1)[n]
    return type(state)(*(take(part, n, dims) for part in state))


def put_together(states: list[Any], batch: torch.Size) -> Any:
    """The opposite of `take`."""
    first = states[0]
    if isinstance(first, Tensor):
        return torch.stack(states).reshape(*batch, *first.shape)
    parts = zip(*states, strict=True)
    return type(first)(*(put_together(list(part), batch) for part in parts))
