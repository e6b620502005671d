"""Light that changes is not motion."""

import numpy as np
import pytest
import torch

from ndtorch.navigation import StereoRig
from ndtorch.navigation.controllers.ranging._kernels_floor import illumination_gain
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.stereo.strips import as_frames
from tests.navigation.proximity.test_check import pair

RIG, DT = StereoRig(forward=0.15), 1 / 30
CONTROL = RangingControl(RIG, DT)


def cells():
    """Grey images of 14 bands by 8 blocks, a texture."""
    return (0.3 + 0.4 * np.random.default_rng(0).random(CONTROL.shape)).astype(np.float32)


@pytest.mark.parametrize("gain", [0.83, 0.97, 1.1, 1.9])
def test_the_gain_is_what_all_cells_share(gain):
    before = cells()
    now = before * np.float32(gain)
    assert illumination_gain(now, before, CONTROL.numbers) == pytest.approx(gain, rel=1e-5)
    # What fills less than half of the cells does not matter.
    now[0, :, :120] = 0.9
    assert illumination_gain(now, before, CONTROL.numbers) == pytest.approx(gain, rel=1e-5)


def test_a_standing_car_sees_no_motion_where_the_light_flickers():
    """Before a wall 1 m ahead."""
    state, seen = None, []
    for gain in (0.8, 0.9, 0.75, 0.85):
        eyes = [(eye[0].double() * gain).round().to(torch.uint8) for eye in pair(1.0)]
        found, state = CONTROL.see(as_frames(*eyes), state)
        seen.append(found[:2])
    # 0.1 of the brightness of the frame would give 0.1 x 0.13 x 20 times it, some 0.1.
    assert float(np.max(seen[1:])) < 0.025
    assert float(np.max(seen)) > 0  # the levels are rounded
