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
    places, nearest = path.moved(runner.state), float(runner.state.place.x)
    assert len(places) > 3
    assert len(np.unique(places, axis=0)) == len(places)
    assert np.hypot(*(places - (nearest, float(runner.state.place.y))).T).min() < 0.04
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
    np.testing.assert_allclose(path.moved(state), [[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]], atol=1e-9)
    turned = np.array([[2.0, 1.0, np.pi / 2]])
    later = SimpleNamespace(located=located._replace(graph=located.graph._replace(poses=turned)))
    np.testing.assert_allclose(path.moved(later), [[2.0, 1.0], [2.0, 1.5], [2.0, 2.0]], atol=1e-9)


def test_the_path_grows_with_the_rooms_and_not_with_the_rounds():
    """Rounds along four walls of four metres; each side is a submap that is merged into that of the first round."""
    path, sizes = WalkedPath(), []
    graph = Localiser(RIG, 1 / 30).start(np.zeros(3)).graph
    firsts = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, np.pi / 2], [4.0, 4.0, np.pi], [0.0, 4.0, -np.pi / 2]])
    merged = np.zeros((0, 5))
    for side in range(4 * 12):
        index, number = side % 4, float(side)
        kept = graph._replace(
            poses=np.concatenate((firsts, firsts[index][None])),
            begun=np.array([0.0, 1.0, 2.0, 3.0, number]),
            merged_submaps=merged,
        )
        located = Localiser(RIG, 1 / 30).start(np.zeros(3))._replace(graph=kept, log=None)
        for ahead in np.arange(0, 4, 0.03):
            x, y, heading = firsts[index]
            pose = np.array((x + np.cos(heading) * ahead, y + np.sin(heading) * ahead, heading))
            state = SimpleNamespace(located=located._replace(pose=pose), place=Pose(*pose))
            path(SimpleNamespace(state=state))
        if side > 3:
            merged = np.concatenate((merged, [[number, index, 0.0, 0.0, 0.0]]))
        sizes.append(sum(map(len, path.places.values())))
    assert sizes[-1] <= sizes[7] + 81
    assert len(path.places) <= 6
    assert sizes[3] >= 4 * 80 - 4
