"""What stands above floor that is seen: remembered as long as no range goes through it."""

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import CRUISE, REVERSE, TURN, Command, Pose, Ranges, RangingParams, StereoRig
from ndtorch.navigation.controllers.contract import Task
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.overhangs import in_the_way, remember_ranges
from ndtorch.navigation.controllers.ranging.patch import cell_numbers, empty_patch
from ndtorch.navigation.controllers.registry import make_controller
from ndtorch.navigation.odometry import drive_step

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


@pytest.mark.parametrize("name", ["published", "goal"])
def test_other_controllers_say_that_they_do_not(name):
    pytest.importorskip("numba")
    made = make_controller("ranging", RIG, DT, RangingControl.params_for(Task(overhangs=True)))
    assert made.params.overhangs
    with pytest.raises(InputError, match="does not remember overhangs"):
        type(make_controller(name, RIG, DT)).params_for(Task(overhangs=True))
