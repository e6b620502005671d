"""Which way the ranging controller turns, and where it only backs."""

import pytest
import torch

from ndtorch.navigation import CRUISE, REVERSE, TURN, AvoidanceParams, Command, Pose
from ndtorch.navigation.controllers.published import SaccadeAvoidance
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.decision import decide
from tests.navigation.controllers.ranging.test_control import DT, RIG, half_hidden, run


@pytest.mark.parametrize(("side", "away"), [(0, -1), (1, 1)])
def test_turns_away_from_hidden_floor(side, away):
    _, commands, modes = run(half_hidden(side), 60)
    turns = commands[:, 1][commands[:, 1] != 0]
    assert TURN in modes[33:43]  # four frames for each cell, and it has to be near
    assert turns.numel() > 10
    assert (turns.sign() == away).all()


@pytest.mark.parametrize(("side", "away"), [(0, -1), (1, 1)])
def test_the_published_rule_turns_towards_it(side, away):
    """The same floor as largest outputs: less motion on the hidden side, and that is where it turns to."""
    sides = torch.full((120, 2), 0.5)
    sides[30:, side] = 0.05
    command, _ = SaccadeAvoidance(DT, AvoidanceParams())(sides)
    turns = command.curvature[command.curvature != 0]
    assert turns.numel() > 10
    assert (turns.sign() == -away).all()


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("open_", [(), (0,), (1,), (0, 1)])
def test_it_turns_where_either_of_both_arcs_of_its_side_is_free(side, open_):
    """A wide one and a tight one; before it knows any way back."""
    control, here = RangingControl(RIG, DT), Pose(*torch.zeros(3).double())
    state = control.start(None, here)
    state = state._replace(
        floor=state.floor._replace(age=state.floor.age + 500),
        mode=state.mode * 0 + CRUISE,
        side=state.side * side,
        bold=state.bold + 1,
    )
    lengths = torch.full((2, 8), 9.0, dtype=torch.float64)
    lengths[:, 0] = 0.1
    ours, others = (slice(1, 3), slice(3, 5)) if side > 0 else (slice(3, 5), slice(1, 3))
    lengths[:, ours] = lengths[:, others] = torch.tensor([9.0 * (k in open_) for k in (0, 1)]).double()
    still = Command(torch.zeros(()).double(), torch.zeros(()).double())
    _, after = decide(lengths, still, state.floor, state.patch, state, control.constants, control.floor, here)
    assert int(after.mode) == (TURN if open_ else REVERSE)
    assert float(after.side) == side
