"""The map of a car: what its pilot knows becomes files."""

import numpy as np
import torch

from ndtorch.navigation import Grid
from ndtorch.navigation.map_files import load_map
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.map_saving import WalkedPath, save_pilot_map
from ndtorch_robot.pilot import Pilot
from ndtorch_robot.ports import DriveCommand, Step
from tests.robot.support.moving_world import RIG, moving_world


def test_a_pilot_saves_its_map_and_the_floor_it_passed(tmp_path):
    grid = Grid(-5, 5, -5, 5)
    pilot, path = Pilot(NavigatorOptions("published"), RIG, 30.0, grid), WalkedPath()
    driven = DriveCommand(0.5, 0.0)
    for number, frames in enumerate(moving_world(20, RIG)):
        wanted = pilot.step(frames, driven)
        path(Step(number, number / 30, frames, driven, wanted, wanted, pilot.state))
    path(Step(20, 20 / 30, None, driven, driven, driven))
    steps = np.hypot(*np.diff(np.array(path.places), axis=0).T)
    assert len(path.places) > 3
    assert (steps > 0.049).all()
    save_pilot_map(tmp_path, pilot, path)
    found = load_map(tmp_path)
    assert found.walls is None
    assert found.grid == grid
    assert torch.equal(found.cells > 0, grid.inner(pilot.state.map.cells) > 0)
    assert (tmp_path / "map.yaml").exists()


def test_a_pilot_that_never_drove_saves_an_empty_map(tmp_path):
    pilot = Pilot(NavigatorOptions("published"), RIG, 30.0, Grid(-1, 1, -1, 1))
    save_pilot_map(tmp_path, pilot, WalkedPath())
    assert float(load_map(tmp_path).cells.max()) == 0.0
