"""A new way from where the car is, for what it is about."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.navigation.controllers.goal.errands import place_of_errand
from ndtorch.navigation.controllers.goal.memory import passed_around, surroundings, visited_cells
from ndtorch.navigation.controllers.goal.params import GoalParams
from ndtorch.navigation.controllers.goal.state import LONGEST, GoalState
from ndtorch.navigation.planning.costmap import LocalMap, clearance
from ndtorch.navigation.planning.frontiers import cheapest_goal, frontier_costs
from ndtorch.navigation.planning.path_tracking import SpeedLimits, speed_profile
from ndtorch.navigation.planning.planner import Plan, goal_costs, plan


def replan(state: GoalState, here: tuple[float, float, float], params: GoalParams, every: int) -> GoalState:
    """The state with a new way.

    Args:
        here: x, y, m, and heading, radians.
        every: time steps until the next plan.
    """
    p, patch = params, params.reactive.grid
    blocked = p.reactive.blocked
    around = surroundings(state.reactive.grid.evidence, here[0], here[1], patch, blocked, -0.1 * blocked)
    clear = clearance(around.blocked, around.cell)
    place = place_of_errand(state, p)
    if place is None:
        visited = visited_cells(state.visited.evidence, here[0], here[1], patch, p.places)
        seed = frontier_costs(around, visited, clear, p.planner)
    else:
        seed = goal_costs(around, place, p.planner)
    at = min(state.at + 1, max(0, state.places - 1))
    curvature = float(state.way[at, 3]) if state.places else 0.0
    through = place is not None
    made = plan(around, clear, seed, here, curvature, float(state.direction), p.planner, through)
    if not through:
        state = give_up(state, made, around, here, p)
    limits = SpeedLimits(p.speed, p.slow, p.creep, p.reactive.reverse_speed, p.braking)
    way, speeds = made.path[:LONGEST], speed_profile(made, around, limits, p.planner)[:LONGEST]
    kept = np.zeros((LONGEST, 6), np.float32)
    kept[: len(way), :5], kept[: len(way), 5] = way, speeds
    return state._replace(
        way=kept,
        places=len(way) if len(way) > 1 else 0,
        at=0,
        due=every,
        cost=float(made.cost),
    )


def give_up(
    state: GoalState, made: Plan, around: LocalMap, here: tuple[float, float, float], params: GoalParams
) -> GoalState:
    """The state of a car that explores. Where it has tried in vain for too long, the place counts as passed.

    Args:
        made: the new plan.
    """
    p, patch = params, params.places
    passed, best = float(state.visited.evidence.sum()), state.best
    newly = (passed - state.passed) * patch.cell**2
    if math.isinf(made.cost):
        return state
    if newly >= p.planner.min_seen_frontier_m2 or made.cost < best - 0.1:
        return state._replace(best=float(made.cost), passed=passed, tried=0.0)
    # Another aim may be far away, and is no success: aims may change to and fro.
    if state.tried < p.in_vain + made.cost / p.creep:
        return state
    place = cheapest_goal(made.to_go, around, p.planner.costmap_cells, here[:2])
    evidence = passed_around(state.visited.evidence, *place, p.given_up, patch)
    visited = state.visited._replace(evidence=evidence)
    return state._replace(visited=visited, best=math.inf, passed=float(evidence.sum()), tried=0.0)
