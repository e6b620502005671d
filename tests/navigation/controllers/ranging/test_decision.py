"""Which way the ranging controller turns, and where it only backs."""

import numpy as np
import pytest
import torch

from ndtorch.navigation import CRUISE, REVERSE, TURN, AvoidanceParams, Pose
from ndtorch.navigation.controllers.published import SaccadeAvoidance
from ndtorch.navigation.controllers.ranging._kernels import decide
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.local_grid._kernels import POSES, SPACING, DrivenPath
from tests.navigation.controllers.ranging.test_control import DT, RIG, half_hidden, run


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


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("open_", [(), (0,), (1,), (0, 1)])
def test_it_turns_where_either_of_both_arcs_of_its_side_is_free(side, open_):
    """A wide one and a tight one; before it knows any way back."""
    control, here = RangingControl(RIG, DT), Pose(0.0, 0.0, 0.0)
    state = control.start(None, here)
    state = state._replace(floor=state.floor._replace(age=500), mode=CRUISE, turn_side=side, has_reversed=1)
    lengths = np.full((2, 8), 9.0, np.float32)
    lengths[:, 0] = 0.1
    ours, others = (slice(1, 3), slice(3, 5)) if side > 0 else (slice(3, 5), slice(1, 3))
    lengths[:, ours] = lengths[:, others] = [9.0 * (k in open_) for k in (0, 1)]
    _, _, after = decide(lengths, tuple(here), (0.0, 0.0), state, control.tables)
    assert after.mode == (TURN if open_ else REVERSE)
    assert after.turn_side == side


@pytest.mark.parametrize(("behind", "bend"), [(0.7, -2.0), (0.5, 0.3), (0.0, 0.3)])
def test_with_much_room_behind_it_turns_on_while_it_backs(behind, bend):
    """Going back the way it came and turning the same way once more would bring a car out of no corner."""
    control, here = RangingControl(RIG, DT), Pose(0.0, 0.0, 0.0)
    # A path that leads back 1 m, to be followed with a curvature of 0.3.
    poses = np.zeros((POSES, 3), np.float32)
    poses[:, 0], poses[4] = -SPACING * np.arange(POSES), (-0.2, 0.15 * 0.04, 0.0)
    poses[4, 1] = 0.3 * (0.2**2) / 2
    state = control.start(None, here)._replace(path=DrivenPath(poses, 21), mode=TURN, age=9)
    state = state._replace(floor=state.floor._replace(age=99))
    lengths = np.full((2, 8), 0.1, np.float32)
    lengths[:, 5] = behind
    speed, curvature, after = decide(lengths, tuple(here), (0.4, 0.0), state, control.tables)
    assert (after.mode, after.reverse_turning) == (REVERSE, int(behind == 0.7))
    assert (speed, curvature) == pytest.approx((-0.3, bend), rel=0.01)
