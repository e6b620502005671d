"""A new way from where the car is, for what it is about."""

from __future__ import annotations

import numpy as np
import torch

from ndtorch.navigation.controllers.goal.errands import place_of_errand
from ndtorch.navigation.controllers.goal.memory import surroundings, visited_cells
from ndtorch.navigation.controllers.goal.params import GoalParams
from ndtorch.navigation.controllers.goal.planning import Planned, clearance, plan, to_place, to_unvisited
from ndtorch.navigation.controllers.goal.speeds import allowed_speeds
from ndtorch.navigation.controllers.goal.state import LONGEST, GoalState


def replan(state: GoalState, here: tuple[float, float, float], params: GoalParams, every: int) -> GoalState:
    """The state with a new way.

    Args:
        here: x, y, m, and heading, radians.
        every: time steps until the next plan.
    """
    p, patch = params, params.reactive.patch
    blocked = p.reactive.blocked
    around = surroundings(state.reactive.patch.evidence, here[0], here[1], patch, blocked, -0.1 * blocked)
    clear = clearance(around.blocked, around.cell)
    place = place_of_errand(state, p)
    if place is None:
        visited = visited_cells(state.visited, here[0], here[1], patch)
        seed = to_unvisited(around, visited, clear, p.way)
    else:
        seed = to_place(around, place, p.way)
    at = min(int(state.at) + 1, max(0, int(state.places) - 1))
    curvature = float(state.way[at, 3]) if int(state.places) else 0.0
    made: Planned = plan(around, clear, seed, here, curvature, float(state.direction), p.way)
    way = made.way[:LONGEST]
    speeds = allowed_speeds(way, around, made, p)
    kept = np.zeros((LONGEST, 6), np.float32)
    kept[: len(way), :5], kept[: len(way), 5] = way, speeds
    return state._replace(
        way=torch.from_numpy(kept).to(state.way.dtype),
        places=torch.full_like(state.places, len(way) if len(way) > 1 else 0),
        at=state.at * 0,
        due=torch.full_like(state.due, every),
        cost=torch.full_like(state.cost, made.cost),
    )
