"""What stands above floor that is seen: remembered as long as no range goes through it."""

import numpy as np
import pytest
import torch

from ndtorch.navigation import CRUISE, REVERSE, TURN, Command, Navigator, Pose, RangingParams, StereoRig
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.tables import grid_numbers
from ndtorch.navigation.local_grid._kernels import add_ranges, bound, costs
from ndtorch.navigation.local_grid.grid import cells_at, empty_grid, mark_obstacles
from ndtorch.navigation.odometry import arc
from ndtorch.navigation.proximity.stereo_match import Obstacles
from ndtorch.navigation.stereo.search import SearchParams
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


def test_what_is_near_is_in_the_way_after_two_looks():
    grid = empty_grid(0.0, 0.0, PARAMS.grid, raised=True)
    grid = grid._replace(raised=grid.raised - 1)
    # Twice in one cell: one look counts once there.
    places = np.array([0.5, 0.51], np.float32), np.array([0.12, 0.13], np.float32)
    once = mark_obstacles(grid, tuple(HERE), *places, PARAMS.range_weight, PARAMS.grid)
    assert worth(once, 0.5, 0.12) == pytest.approx(1.0)
    assert worth(once, 0.5, 0.30) == pytest.approx(-1.0)
    twice = mark_obstacles(once, tuple(HERE), *places, PARAMS.range_weight, PARAMS.grid)
    assert worth(twice, 0.5, 0.12) >= PARAMS.blocked
    assert mark_obstacles(grid, tuple(HERE), places[0][:0], places[1][:0], 1.0, PARAMS.grid) is grid


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


def test_one_searched_range_stands_in_the_way_and_what_lies_before_it_less():
    control = RangingControl(RIG, DT)
    p = control.params
    state = control.start(None, HERE)
    assert control.on_extra_ranges(state, HERE, None, None).grid.raised is state.grid.raised
    told = control.on_extra_ranges(state, HERE, ranged((1.2, 0.15)), None).grid
    assert worth(told, 1.2, 0.15) == pytest.approx(p.search_weight)
    assert p.search_weight >= p.blocked
    behind = control.on_extra_ranges(state._replace(grid=told), HERE, ranged((2.0, 0.15)), None).grid
    assert worth(behind, 1.2, 0.15) < p.blocked
    near = Obstacles(np.array([0.5], np.float32), np.array([0.1], np.float32))
    assert worth(control.on_extra_ranges(state, HERE, None, near).grid, 0.5, 0.1) == pytest.approx(p.range_weight)
    assert not state.grid.raised.any()


class Asking(RangingControl):
    """Writes down what it is told."""

    def on_extra_ranges(self, state, pose, ranges, obstacles):
        self.told.append((ranges, obstacles))
        return super().on_extra_ranges(state, pose, ranges, obstacles)


@pytest.mark.parametrize(("search", "given"), [(None, True), (SearchParams(), False)])
def test_the_navigator_searches_for_it_unless_all_ranges_are_searched_for(search, given):
    control = Asking(RIG, DT)
    control.told = []
    navigator = Navigator(RIG, DT, controller=control, search=search, near_check=True)
    rows = torch.randint(0, 256, (1, 3, RIG.height, RIG.width), generator=torch.Generator().manual_seed(3))
    left = rows.to(torch.uint8)
    _, state = navigator(left, left.roll(-100, -1))
    control.told.clear()
    state = state._replace(control=state.control._replace(age=0, mode=CRUISE))
    told = navigator.near.while_driving(
        navigator.controller, state.control, state.pose, (left[0], left.roll(-100, -1)[0])
    )
    [(ranges, things)] = control.told
    assert things is None
    assert (ranges is not None) == given
    if given:
        depth = RIG.focal * RIG.baseline / 100 + RIG.forward
        assert ranges.x[ranges.valid] == pytest.approx(np.full(int(ranges.valid.sum()), depth), rel=0.02)
        assert int(ranges.valid.sum()) == SearchParams().count
        assert told.grid.raised.max() >= control.params.blocked
