"""What the goal controller is about, and when that is done."""

import torch

from ndtorch.navigation import ARRIVED
from ndtorch.navigation.controllers.goal import GoalControl, GoalParams
from ndtorch.navigation.controllers.goal.errands import BACK, DONE, EXPLORE, TO, asked, finds_nothing, next_errand
from tests.navigation.controllers.goal.test_goal_control import DT, RIG, SMALL, drive, floor, nothing, place

HERE = (0.0, 0.0, 0.0)


def test_only_what_was_asked_for_and_exploring_where_nothing_was():
    assert asked(GoalParams()) == [EXPLORE, DONE]
    assert asked(GoalParams(to=(1.0, 0.0), back=True)) == [TO, BACK, DONE]
    assert asked(GoalParams(to=(0.0, 0.0), explore=True)) == [TO, EXPLORE, DONE]


def test_a_place_is_reached_and_exploring_is_given_up_only_after_a_while():
    params = GoalParams(to=(0.2, 0.0), explore=True, reactive=SMALL)
    control = GoalControl(RIG, DT, params)
    state = control.start(floor(), place(*HERE))
    assert int(next_errand(state, (2.0, 0.0, 0.0), control.errands, params).errand) == TO
    state = next_errand(state, HERE, control.errands, params)
    assert int(state.errand) == EXPLORE
    assert not finds_nothing(state)
    state = state._replace(cost=torch.tensor(float("inf")), fruitless=torch.tensor(params.patience - 0.1))
    assert finds_nothing(state)
    assert int(next_errand(state, HERE, control.errands, params).errand) == EXPLORE
    state = next_errand(state._replace(fruitless=torch.tensor(params.patience)), HERE, control.errands, params)
    assert int(state.errand) == DONE
    assert float(state.fruitless) == 0


def test_where_no_floor_was_seen_yet_the_reactive_controller_drives_before_exploring_is_given_up():
    control = GoalControl(RIG, DT, GoalParams(explore=True, patience=1.0, reactive=SMALL))
    pose, state, command = drive(control, 16, place(*HERE))  # standing and learning
    moved, steps = False, 0
    while int(control.mode(state)) != ARRIVED and steps < 60:
        # Cells that show nothing: neither floor nor its end is known.
        command, state = control.step(floor(moves=False), nothing(), pose, command, blind(state))
        moved, steps = moved or float(command.speed) > 0, steps + 1
    assert moved
    assert 28 <= steps <= 35


def blind(state):
    """Nothing is known of the surroundings."""
    patch = state.reactive.patch
    reactive = state.reactive._replace(patch=patch._replace(evidence=torch.zeros_like(patch.evidence)))
    return state._replace(reactive=reactive)
