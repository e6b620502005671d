"""A car that stands goes on as fast as before once what disturbed its view is gone."""

import numpy as np
import pytest

from ndtorch.navigation import STOPPED, Command, Pose
from ndtorch.navigation.controllers.ranging._kernels import limit
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


@pytest.mark.parametrize(("known", "share"), [(3, 0.0), (4, 2 / 28), (7, 0.5), (10, 13 / 14), (11, 1.0), (14, 1.0)])
def test_speed_falls_with_the_bands_of_floor_that_are_told_from_noise(known, share):
    """Nothing up to a quarter of the bands, all from three quarters on, and a straight line between."""
    control, pose = RangingControl(RIG, DT), Pose(0.0, 0.0, 0.0)
    state, command = control.start(None, pose), Command(0.0, 0.0)
    for n in range(40):
        command, state = control.step(cells_of(open_floor(pose, n), *command), NOWHERE, pose, command, state)
    level = np.where(np.arange(BANDS) < known, state.floor.level, 0).astype(np.float32)
    seen = limit(0.5, 0.2, state._replace(floor=state.floor._replace(level=level)), 9.0, 0.0, control.tables)
    assert seen[0] == pytest.approx(0.5 * share, abs=1e-6)
    assert seen[1] == (0.2 if share else 0.0)
    assert (seen[2].mode == STOPPED) == (not share)
    assert limit(-0.3, 0.2, state._replace(floor=state.floor._replace(level=level)), 9.0, 0.0, control.tables)[0] in (
        -0.3,
        0.0,
    )
