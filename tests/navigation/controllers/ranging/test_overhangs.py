"""What stands above floor that is seen: remembered as long as no range goes through it."""

import numpy as np
import pytest

from ndtorch.navigation import CRUISE, REVERSE, TURN, Command, Pose, RangingParams, StereoRig
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.tables import grid_numbers
from ndtorch.navigation.local_grid._kernels import add_ranges, bound, costs
from ndtorch.navigation.local_grid.grid import cells_at, empty_grid
from ndtorch.navigation.odometry import arc
from tests.navigation.controllers.ranging.test_control import cells_of, open_floor, ranges_of, seen_from

DT = 1 / 30
RIG = StereoRig(forward=0.15)
HERE = Pose(0.0, 0.0, 0.0)
PARAMS = RangingParams(overhangs=True)


def ranged(*places):
    return ranges_of(np.array(places).T)


def cell(x, y):
    return cells_at(tuple(HERE), [x], [y], PARAMS.grid)[0]


def worth(grid, x, y):
    return float(grid.raised.reshape(-1)[cell(x, y)])


def with_ranges(grid, *places):
    numbers, raised = grid_numbers(RIG, PARAMS, DT, 0.0), grid.raised.copy()
    there = ranged(*places)
    add_ranges(raised, (there.x, there.y, there.valid), tuple(HERE), numbers, numbers.range_weight, numbers.miss)
    bound(raised, -numbers.least, numbers.most)
    return grid._replace(raised=raised)


def test_a_range_counts_and_one_behind_it_takes_it_away():
    grid, here = empty_grid(0.0, 0.0, PARAMS.grid, raised=True), cell(1.2, 0.15)
    for _ in range(3):
        grid = with_ranges(grid, (1.2, 0.15))
    assert worth(grid, 1.2, 0.15) == pytest.approx(3.0)
    assert worth(grid, 0.7, 0.15) < 0
    assert costs(grid, 1.9).reshape(-1)[here] == pytest.approx(1.9)
    for _ in range(10):
        grid = with_ranges(grid, (2.0, 0.15))
    assert worth(grid, 1.2, 0.15) < 1.9
    assert costs(grid, 1.9).reshape(-1)[here] == 0.0


def driven(overhangs, frames=150):
    """A car on open floor, 2.5 m before a board across its path with air below it, which is ranged in a few frames."""
    control = RangingControl(RIG, DT, RangingParams(overhangs=overhangs))
    pose, command, modes = HERE, Command(0.0, 0.0), []
    state = control.start(None, pose)
    for n in range(frames):
        x, y = seen_from(pose, np.stack((np.full(8, 2.5), np.linspace(-0.5, 0.5, 8))))
        there = ranges_of((x, y), (x > 2.0) & (x < 2.06))
        cells = cells_of(open_floor(pose, n), command.speed)
        command, state = control.step(cells, there, pose, command, state)
        modes.append(control.mode(state))
        pose = arc(pose, *command, DT)
    return pose.x, modes


def test_floor_below_a_board_does_not_free_it():
    away, modes = driven(overhangs=True)
    assert TURN in modes
    assert away < 2.5
    through, modes = driven(overhangs=False)
    assert set(modes[20:]) == {CRUISE}
    assert REVERSE not in modes
    assert through > 2.0


def test_it_looks_ahead_every_so_often_and_near_in_turns_alone():
    control = RangingControl(RIG, DT)
    state = control.start(None, HERE)
    turning = state._replace(mode=TURN)
    looks = [control.sensing_requests(turning._replace(age=age)) for age in range(20)]
    assert [age for age, look in enumerate(looks) if look.ahead] == [0, 5, 10, 15]
    # Not both in one step, unless every step has one.
    assert [age for age, look in enumerate(looks) if look.near] == [2, 7, 12, 17]
    assert RangingControl(RIG, 0.2).sensing_requests(turning) == (True, True)
    for mode in (CRUISE, REVERSE):
        driving = [state._replace(mode=mode, age=age) for age in (5, 7)]
        assert [tuple(control.sensing_requests(each)) for each in driving] == [(True, False), (False, False)]
    assert not any(RangingControl(RIG, DT, RangingParams(overhangs=False)).sensing_requests(turning))
