"""A car that stands goes on as fast as before once what disturbed its view is gone."""

import numpy as np
import pytest

from ndtorch.navigation import STOPPED, Command, Pose
from ndtorch.navigation.controllers.ranging.control import RangingControl
from tests.navigation.controllers.ranging.test_control import BANDS, BLOCKS, DT, NOWHERE, RIG, cells_of, open_floor


@pytest.mark.parametrize("moves", [0.06, 0.3])
def test_noise_of_a_passer_by_is_forgotten_before_the_car_goes_on(moves):
    control, pose, command = RangingControl(RIG, DT), Pose(0.0, 0.0, 0.0), Command(0.0, 0.0)
    state, speeds, modes = control.start(None, pose), [], []
    for n in range(180):
        passes = 60 <= n < 75
        driven = Command(0.0, 0.0) if passes else command
        cells = np.full((2, BANDS, BLOCKS), moves, np.float32) if passes else cells_of(open_floor(pose, n), *driven)
        command, state = control.step(cells, NOWHERE, pose, driven, state)
        speeds.append(command.speed)
        modes.append(control.mode(state))
    assert speeds[59] == 0.5
    assert modes[74] == STOPPED
    assert max(speeds[70:75]) == 0.0
    begins = next(n for n in range(75, 180) if speeds[n] > 0)
    assert begins < 120  # noise falls by a third with every step
    assert speeds[begins + 20] == 0.5
    assert control.status_message(state) is None
