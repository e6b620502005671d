"""A car that stands goes on as fast as before once what disturbed its view is gone."""

from contextlib import nullcontext

import pytest
import torch

from ndtorch.navigation import STOPPED, Command, Pose
from ndtorch.navigation.controllers.ranging.control import RangingControl
from tests.navigation.controllers.ranging.test_control import BANDS, BLOCKS, DT, RIG, cells_of, open_floor, ranges_of

NOWHERE = ranges_of(torch.zeros(2, 1), torch.zeros(1, dtype=torch.bool))


@pytest.mark.parametrize("kernels", [False, True])
@pytest.mark.parametrize("moves", [0.06, 0.3])
def test_noise_of_a_passer_by_is_forgotten_before_the_car_goes_on(kernels, moves):
    control = RangingControl(RIG, DT)
    pose = Pose(*map(torch.tensor, (0.0, 0.0, 0.0)))
    command, state = Command(torch.tensor(0.0), torch.tensor(0.0)), control.start(None, pose)
    speeds, modes = [], []
    with torch.inference_mode() if kernels else nullcontext():
        for n in range(180):
            passes = 60 <= n < 75
            driven = Command(torch.tensor(0.0), torch.tensor(0.0)) if passes else command
            cells = cells_of(open_floor(pose, n), float(driven.speed), float(driven.curvature))
            if passes:
                cells = torch.full((2, BANDS, BLOCKS), moves)
            command, state = control.step(cells, NOWHERE, pose, driven, state)
            speeds.append(float(command.speed))
            modes.append(int(control.mode(state)))
    assert speeds[59] == 0.5
    assert modes[74] == STOPPED
    assert max(speeds[70:75]) == 0.0
    begins = next(n for n in range(75, 180) if speeds[n] > 0)
    assert begins < 120  # noise falls by a third with every step
    assert speeds[begins + 20] == 0.5
    assert control.trouble(state) is None
