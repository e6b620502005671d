"""A new way: where it begins, what of it is kept, and what is taken for floor."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ndtorch.navigation.controllers.goal import GoalControl, GoalParams
from ndtorch.navigation.controllers.goal.replanning import replan
from ndtorch.navigation.controllers.goal.tasks import EXPLORE, GoalState
from tests.navigation.controllers.goal.test_goal_control import DT, RIG, SMALL, floor, place

pytest.importorskip("numba")
HERE = (0.3, -0.2, 0.1)
PARAMS = GoalParams(goal=(2.0, 0.0), reactive=SMALL)


def known(evidence: float, params: GoalParams = PARAMS) -> GoalState:
    """All that is around the car was seen so far, in shares of what counts as blocked."""
    state = GoalControl(RIG, DT, params).start(floor(), place(*HERE))
    grid = state.reactive.grid
    grid = grid._replace(evidence=np.full_like(grid.evidence, evidence * params.reactive.blocked_evidence))
    return state._replace(reactive=state.reactive._replace(grid=grid))


def test_as_much_is_kept_as_was_planned_with_the_speeds_that_are_allowed() -> None:
    made = replan(known(-1.0), HERE, PARAMS, 7)
    places = int(made.points)
    # Arcs of 0.2 m for 1.7 m, after the place where the car is.
    assert places == pytest.approx(1 + math.dist(HERE[:2], (2.0, 0.0)) / PARAMS.planner.step_m, abs=1.5)
    assert not made.path[places:].any()
    assert float(made.cost) == pytest.approx(math.dist(HERE[:2], (2.0, 0.0)), abs=0.15)
    speeds = made.path[:places, 5]
    assert float(speeds[0]) == PARAMS.speed_m_per_s
    assert bool((speeds > 0).all())


def test_what_is_blocked_is_driven_through_at_its_price_to_a_place_and_not_at_all_when_exploring() -> None:
    costs = [float(replan(known(evidence), HERE, PARAMS, 7).cost) for evidence in (0.999, 1.0)]
    assert costs[0] < 4 < PARAMS.planner.obstacle_cost < costs[1]
    params = GoalParams(explore=True, reactive=SMALL)
    state = known(1.0, params)
    assert int(state.task) == EXPLORE
    made = replan(state, HERE, params, 7)
    assert (float(made.points), math.isinf(float(made.cost))) == (0.0, True)
