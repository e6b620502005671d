"""Which way the ranging controller turns, and where it only backs."""

import numpy as np
import pytest
import torch

from ndtorch.navigation import TURN, AvoidanceParams
from ndtorch.navigation.controllers.published import SaccadeAvoidance
from tests.navigation.controllers.ranging.test_control import DT, half_hidden, run


@pytest.mark.parametrize(("side", "away"), [(0, -1), (1, 1)])
def test_turns_away_from_hidden_floor(side, away):
    _, commands, modes = run(half_hidden(side), 60)
    turns = commands[:, 1][commands[:, 1] != 0]
    assert TURN in modes[33:43]  # four frames for each cell, and it has to be near
    assert len(turns) > 10
    assert (np.sign(turns) == away).all()


@pytest.mark.parametrize(("side", "away"), [(0, -1), (1, 1)])
def test_the_published_rule_turns_towards_it(side, away):
    """The same floor as largest outputs: less motion on the hidden side, and that is where it turns to."""
    sides = torch.full((120, 2), 0.5)
    sides[30:, side] = 0.05
    command, _ = SaccadeAvoidance(DT, AvoidanceParams())(sides)
    turns = command.curvature[command.curvature != 0]
    assert turns.numel() > 10
    assert (turns.sign() == -away).all()
