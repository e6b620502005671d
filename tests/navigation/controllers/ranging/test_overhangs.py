"""What stands above floor that is seen: remembered as long as no range goes through it."""

import numpy as np
import pytest
import torch

from ndtorch.navigation import CRUISE, REVERSE, TURN, Command, Navigator, Pose, Ranges, RangingParams, StereoRig
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.overhangs import in_the_way, remember_ranges, remember_things
from ndtorch.navigation.controllers.ranging.patch import cell_numbers, empty_patch
from ndtorch.navigation.odometry import drive_step
from ndtorch.navigation.proximity.stereo_match import Obstacles
from ndtorch.navigation.row_search import SearchParams

DT = 1 / 30
RIG = StereoRig(forward=0.15)
HERE = Pose(*torch.zeros(3))
BODY = torch.zeros(2, 1)


def ranged(*places):
    x, y = torch.tensor(places).T
    none = torch.zeros_like(x)
    return Ranges(none, none, none, x, y, torch.ones_like(x, dtype=torch.bool))


def worth(patch, x, y, params):
    number = cell_numbers(torch.tensor([[x], [y]]), HERE, params.patch)
    return float(patch.upright.gather(-1, number))


def test_a_range_counts_and_one_behind_it_takes_it_away():
    params = RangingParams(overhangs=True)
    patch = empty_patch(HERE, params.patch, upright=True)
    for _ in range(3):
        patch = remember_ranges(patch, ranged((1.2, 0.15)), HERE, BODY, RIG, params)
    assert worth(patch, 1.2, 0.15, params) == pytest.approx(3.0)
    assert worth(patch, 0.7, 0.15, params) < 0
    number = cell_numbers(torch.tensor([[1.2], [0.15]]), HERE, params.patch)
    assert float(in_the_way(patch, 1.9).gather(-1, number)) == pytest.approx(1.9)
    for _ in range(10):
        patch = remember_ranges(patch, ranged((2.0, 0.15)), HERE, BODY, RIG, params)
    assert worth(patch, 1.2, 0.15, params) < 1.9
    assert float(in_the_way(patch, 1.9).gather(-1, number)) == 0.0


def test_many_cars_at_once_are_each_as_one():
    params = RangingParams(overhangs=True)
    two = Pose(torch.tensor([0.0, 0.3]), torch.zeros(2), torch.tensor([0.0, 0.5]))
    both = Ranges(*(torch.stack((part, part)) for part in ranged((1.2, 0.15), (0.9, -0.2))))
    together = remember_ranges(empty_patch(two, params.patch, True), both, two, BODY, RIG, params)
    for n in range(2):
        pose = Pose(*(part[n] for part in two))
        one = ranged((1.2, 0.15), (0.9, -0.2))
        alone = remember_ranges(empty_patch(pose, params.patch, True), one, pose, BODY, RIG, params)
        torch.testing.assert_close(alone.upright, together.upright[n])


def driven(overhangs, frames=150, watch=None):
    """A car on open floor, 2.5 m before a board across its way with air below it, which is ranged in a few frames."""
    control = RangingControl(RIG, DT, RangingParams(overhangs=overhangs))
    view = control.look.view
    pose, command, state, modes = HERE, Command(*torch.zeros(2)), None, []
    for _ in range(frames):
        speed = float(command.speed)
        flow = 430 * 0.2 / view.depth.square() * abs(speed) * DT
        floor = (0.18 * (1 - torch.exp(-flow / 1.2)))[:, None].expand(2, *view.x.shape[1:])
        x, y = 2.5 - pose.x, torch.linspace(-0.5, 0.5, 8) - pose.y
        cos, sin = pose.heading.cos(), pose.heading.sin()
        there = ranged(*zip((cos * x + sin * y).tolist(), (cos * y - sin * x).tolist(), strict=True))
        there = there._replace(valid=(there.x > 2.0) & (there.x < 2.06))
        if state is None:
            state = control.start(floor, pose)
        if watch is not None:
            watch(control, (floor, there, pose, command, state))
        command, state = control.step(floor, there, pose, command, state)
        modes.append(int(control.mode(state)))
        pose = drive_step(pose, *command, DT)
    return float(pose.x), modes


def test_floor_below_a_board_does_not_free_it():
    away, modes = driven(overhangs=True)
    assert TURN in modes
    assert away < 2.5
    through, modes = driven(overhangs=False)
    assert set(modes[20:]) == {CRUISE}
    assert REVERSE not in modes
    assert through > 2.0


def test_every_step_by_kernels_is_that_of_torch():
    pytest.importorskip("numba")
    blocked = []

    def both(control, given):
        with torch.no_grad():
            wanted, slow = control.steer(*given)
        with torch.inference_mode():
            found, quick = control.steer(*given)
        torch.testing.assert_close(torch.stack(found), torch.stack(wanted))
        torch.testing.assert_close(torch.stack(quick[2:9]), torch.stack(slow[2:9]))
        # A place at the border of two cells may be rounded into either of them.
        for one, other in zip(quick.patch, slow.patch, strict=True):
            assert int(((one - other).abs() > 1e-4).sum()) <= 16
        blocked.append(int((quick.patch.upright >= control.params.blocked).sum()))

    _, modes = driven(overhangs=True, watch=both)
    assert TURN in modes
    assert max(blocked) >= 3


def test_what_is_near_is_in_the_way_after_two_looks():
    params = RangingParams(overhangs=True)
    patch = empty_patch(HERE, params.patch, upright=True)
    # Twice in one cell: one look counts once there.
    things = Obstacles(np.array([0.5, 0.51], np.float32), np.array([0.12, 0.13], np.float32))
    patch = patch._replace(upright=patch.upright - 1.0)
    once = remember_things(patch, HERE, things, params)
    assert worth(once, 0.5, 0.12, params) == pytest.approx(1.0)
    assert worth(once, 0.5, 0.30, params) == pytest.approx(-1.0)
    twice = remember_things(once, HERE, things, params)
    assert worth(twice, 0.5, 0.12, params) >= params.blocked
    nothing = Obstacles(things.x[:0], things.y[:0])
    assert remember_things(patch, HERE, nothing, params) is patch


def test_it_looks_ahead_every_so_often_and_near_in_turns_alone():
    control = RangingControl(RIG, DT)
    state = control.start(torch.zeros(2, control.params.floor.bands, control.params.floor.blocks), HERE)
    turning = state._replace(mode=torch.tensor(float(TURN)))
    looks = [control.glances(turning._replace(age=torch.tensor(float(age)))) for age in range(20)]
    assert [age for age, look in enumerate(looks) if look.ahead] == [0, 5, 10, 15]
    # Not both in one step, unless every step has one.
    assert [age for age, look in enumerate(looks) if look.near] == [2, 7, 12, 17]
    assert RangingControl(RIG, 0.2).glances(turning) == (True, True)
    for mode in (CRUISE, REVERSE):
        driving = [state._replace(mode=torch.tensor(float(mode)), age=torch.tensor(float(age))) for age in (5, 7)]
        assert [tuple(control.glances(each)) for each in driving] == [(True, False), (False, False)]
    assert not any(RangingControl(RIG, DT, RangingParams(overhangs=False)).glances(turning))


def test_one_searched_range_stands_in_the_way_and_what_lies_before_it_less():
    control = RangingControl(RIG, DT)
    p = control.params
    state = control.start(torch.zeros(2, p.floor.bands, p.floor.blocks), HERE)
    here = ranged((1.2, 0.15))
    assert control.told_more(state, HERE, None, None).patch.upright.eq(state.patch.upright).all()
    told = control.told_more(state, HERE, here, None).patch
    assert worth(told, 1.2, 0.15, p) == pytest.approx(p.glance_weight)
    assert p.glance_weight >= p.blocked
    behind = control.told_more(state._replace(patch=told), HERE, ranged((2.0, 0.15)), None).patch
    assert worth(behind, 1.2, 0.15, p) < p.blocked
    near = control.told_more(
        state, HERE, None, Obstacles(np.array([0.5], np.float32), np.array([0.1], np.float32))
    ).patch
    assert worth(near, 0.5, 0.1, p) == pytest.approx(p.range_weight)


def test_what_a_search_tells_is_remembered_alike_by_kernel_and_torch():
    pytest.importorskip("numba")
    control = RangingControl(RIG, DT)
    p, pose = control.params, Pose(*torch.tensor([0.31, -0.47, 0.6]))
    state = control.start(torch.zeros(2, p.floor.bands, p.floor.blocks), pose)
    there = ranged((1.2, 0.15), (0.83, -0.31), (2.2, 0.4), (1.4, 0.7))
    there = there._replace(valid=torch.tensor([True, True, True, False]))
    told = []
    for mode in (torch.no_grad, torch.inference_mode):
        with mode():
            told.append(control.told_more(control.told_more(state, pose, there, None), pose, there, None).patch.upright)
    assert not state.patch.upright.any()
    assert int((told[0] >= p.blocked).sum()) == 3
    # A place at the border of two cells may be rounded into either of them.
    assert int(((told[0] - told[1]).abs() > 1e-5).sum()) <= 2


class Asking(RangingControl):
    """Writes down what it is told."""

    def told_more(self, state, pose, ranges, things):
        self.told.append((ranges, things))
        return super().told_more(state, pose, ranges, things)


@pytest.mark.parametrize(("search", "given"), [(None, True), (SearchParams(), False)])
def test_the_navigator_searches_for_it_unless_all_ranges_are_searched_for(search, given):
    pytest.importorskip("numba")
    control = Asking(RIG, DT)
    control.told = []
    navigator = Navigator(RIG, DT, controller=control, search=search, near_check=True)
    rows = torch.randint(0, 256, (1, 3, RIG.height, RIG.width), generator=torch.Generator().manual_seed(3))
    left = rows.to(torch.uint8)
    with torch.inference_mode():
        _, state = navigator(left, left.roll(-100, -1))
        control.told.clear()
        state = state._replace(control=state.control._replace(age=torch.tensor(0.0), mode=torch.tensor(float(CRUISE))))
        told = navigator.near.while_driving(
            navigator.controller, state.control, state.pose, (left[0], left.roll(-100, -1)[0])
        )
    [(ranges, things)] = control.told
    assert things is None
    assert (ranges is not None) == given
    if given:
        depth = RIG.focal * RIG.baseline / 100 + RIG.forward
        assert ranges.x[ranges.valid] == pytest.approx(torch.full((int(ranges.valid.sum()),), depth), rel=0.02)
        assert int(ranges.valid.sum()) == SearchParams().count
        assert told.patch.upright.max() >= control.params.blocked
