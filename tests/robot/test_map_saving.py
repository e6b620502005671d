"""The map of a car: what its runner knows becomes files."""

from types import SimpleNamespace

import numpy as np
import torch

from ndtorch.navigation import Grid, Pose
from ndtorch.navigation.localisation import Localiser
from ndtorch.navigation.mapping.map_files import load_map
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.map_saving import WalkedPath, save_runner_map
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import DriveCommand, Step
from tests.robot.support.moving_world import RIG, moving_world


def test_a_pilot_saves_its_map_and_the_floor_it_passed(tmp_path):
    grid = Grid(-5, 5, -5, 5)
    runner, path = NavigatorRunner(NavigatorOptions("published"), RIG, 30.0, grid), WalkedPath()
    driven = DriveCommand(0.5, 0.0)
    for number, frames in enumerate(moving_world(20, RIG)):
        wanted = runner.step(frames, driven)
        path(Step(number, number / 30, frames, driven, wanted, wanted, runner.state))
    path(Step(20, 20 / 30, None, driven, driven, driven))
    steps = np.hypot(*np.diff(np.array(path.places), axis=0).T)
    assert len(path.places) > 3
    assert (steps > 0.049).all()
    save_runner_map(tmp_path, runner, path)
    found = load_map(tmp_path)
    assert found.ndt_cells is None
    assert found.grid == grid
    assert torch.equal(found.cells > 0, grid.inner(runner.state.map.cells) > 0)
    assert (tmp_path / "map.yaml").exists()


def test_the_path_moves_with_the_submaps():
    localiser, path = Localiser(RIG, 1 / 30), WalkedPath()
    for x in (0.0, 0.5, 1.0):
        located = localiser.start(np.zeros(3))._replace(pose=np.array((x, 0.0, 0.0)))
        place = Pose(*(torch.tensor(v) for v in (x, 0.0, 0.0)))
        state = SimpleNamespace(located=located, place=place)
        path(SimpleNamespace(state=state))
    assert path.moved(state).tolist() == [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]]
    turned = np.array([[2.0, 1.0, np.pi / 2]])
    later = SimpleNamespace(located=located._replace(graph=located.graph._replace(poses=turned)))
    np.testing.assert_allclose(path.moved(later), [[2.0, 1.0], [2.0, 1.5], [2.0, 2.0]], atol=1e-9)
    assert path.moved(None).tolist() == [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]]
