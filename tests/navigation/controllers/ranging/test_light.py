"""Light that changes is not motion."""

import pytest
import torch

from ndtorch.navigation import StereoRig
from ndtorch.navigation.controllers.ranging.floor_motion import FloorMotion
from ndtorch.navigation.controllers.ranging.light import light_gain
from tests.navigation.proximity.test_check import pair

RIG, DT = StereoRig(forward=0.15), 1 / 30


def cells(*batch):
    """Grey images of 4 bands by 3 blocks, a texture."""
    return 0.3 + 0.4 * torch.rand(*batch, 2, 8, 12, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("gain", [0.83, 0.97, 1.1, 1.9])
def test_the_gain_is_what_all_cells_share(gain):
    before = cells(3)
    found = light_gain(before * gain, before, 4, 3)
    torch.testing.assert_close(found, torch.full((3,), gain))
    # What fills less than half of the cells does not matter.
    now = before * gain
    now[..., 0, :, :9] = 0.9
    torch.testing.assert_close(light_gain(now, before, 4, 3), found)


@pytest.mark.parametrize("gain", [1.0, 1.005, 0.992, 2.5, 0.3])
def test_what_no_lamp_does_is_left_alone(gain):
    before = cells()
    assert float(light_gain(before * gain, before, 4, 3)) == 1.0
    assert float(light_gain(before * 0, before * 0, 4, 3)) == 1.0


def flickering(gains):
    """A standing car before a wall 1 m ahead, and how bright each frame is."""
    eyes = pair(1.0)
    return [torch.cat([eye.double() * gain for gain in gains]).round().to(torch.uint8) for eye in eyes]


def test_a_standing_car_sees_no_motion_where_the_light_flickers():
    left, right = flickering([0.8, 0.9, 0.75, 0.85])
    with torch.no_grad():
        seen, _ = FloorMotion(RIG, DT)(left, right)
    # 0.1 of the brightness of the frame would give 0.1 x 0.13 x 20 times it, some 0.1.
    assert float(seen[1:, :2].amax()) < 0.025
    assert float(seen[:, :2].amax()) > 0  # the levels are rounded


def test_the_kernel_takes_out_the_same():
    pytest.importorskip("numba")
    left, right = flickering([0.8, 0.9, 0.75, 0.85])
    look, found = FloorMotion(RIG, DT), []
    for mode in (torch.no_grad, torch.inference_mode):
        state, run = None, []
        with mode():
            for n in range(len(left)):
                seen, state = look(left[n : n + 1], right[n : n + 1], state)
                run.append(seen)
        found.append(torch.cat(run))
    torch.testing.assert_close(found[1], found[0], rtol=1e-4, atol=1e-5)


def test_frames_one_by_one_and_together_are_the_same():
    left, right = flickering([0.8, 0.9, 0.75])
    look = FloorMotion(RIG, DT)
    with torch.no_grad():
        whole, _ = look(left, right)
        first, state = look(left[:1], right[:1])
        rest, _ = look(left[1:], right[1:], state)
    torch.testing.assert_close(torch.cat((first, rest)), whole)
