"""When the navigator begins anew, and what it keeps then."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from ndtorch.navigation import Grid, Pose, Ranges
from ndtorch.navigation.mapping.map_files import load_map, save_map
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.navigator_runner import NavigatorRunner, WalkedPath, save_runner_map
from ndtorch_robot.ports import STAND, DriveCommand, Step
from ndtorch_robot.sim.arenas import load_arena
from ndtorch_robot.sim.plan import SpawnPoints
from tests.robot.support.cars import RIG, moving_world

DRIVEN = DriveCommand(0.5, 0.2)


def pilot_on_its_way(frames, steps=30):
    runner = NavigatorRunner(NavigatorOptions("published"), RIG, 30.0, Grid(-5, 5, -5, 5))
    for _ in range(steps):
        runner.step(next(frames), DRIVEN)
    return runner


def pose(runner):
    return tuple(float(value) for value in runner.state.pose)


@pytest.mark.parametrize("placed", [None, (1.0, -2.0, 0.5)])
def test_after_a_gap_it_compares_with_nothing_and_keeps_the_map(placed):
    frames = moving_world(40, RIG)
    runner = pilot_on_its_way(frames)
    before, cells = runner.state, runner.state.map.cells.clone()
    seen = next(frames)
    wanted = runner.step(seen, DRIVEN, placed, anew=placed is None)
    fresh = NavigatorRunner(NavigatorOptions("published"), RIG, 30.0)
    first = fresh.step(seen, DRIVEN)
    assert wanted == first
    assert (runner.state.sides == fresh.state.sides).all()
    assert torch.equal(runner.state.map.cells, cells)
    along = before.pose.x + 0.5 / 30 * math.cos(before.pose.heading)
    assert pose(runner)[0] == pytest.approx(placed[0] if placed else float(along), abs=1e-3)


def test_it_knows_how_far_it_rolls_and_that_frames_were_lost():
    frames = moving_world(60, RIG)
    runner = pilot_on_its_way(frames)
    before = pose(runner)
    runner.roll(DRIVEN)
    rolled = np.hypot(pose(runner)[0] - before[0], pose(runner)[1] - before[1])
    assert rolled == pytest.approx(0.5 / 30, rel=1e-3)
    before, seen = pose(runner), next(frames)
    next(frames)
    runner.step(seen._replace(time=runner.time + 3 / 30), DRIVEN)
    driven = np.hypot(pose(runner)[0] - before[0], pose(runner)[1] - before[1])
    assert driven == pytest.approx(3 * 0.5 / 30, rel=1e-3)


def test_a_car_that_was_put_somewhere_before_the_first_step_knows_where():
    runner = NavigatorRunner(NavigatorOptions("published"), RIG, 30.0)
    runner.step(next(moving_world(1, RIG)), DRIVEN, (3.0, 4.0, 1.0))
    assert pose(runner) == (3.0, 4.0, 1.0)


def test_a_pilot_saves_its_map_and_the_floor_it_passed(tmp_path):
    grid = Grid(-5, 5, -5, 5)
    runner, path = NavigatorRunner(NavigatorOptions("published"), RIG, 30.0, grid), WalkedPath()
    driven = DriveCommand(0.5, 0.0)
    for number, frames in enumerate(moving_world(20, RIG)):
        wanted = runner.step(frames, driven)
        path(Step(number, number / 30, frames, driven, wanted, wanted, runner.state))
    path(Step(20, 20 / 30, None, driven, driven, driven))
    places, nearest = path.places(), float(runner.state.place.x)
    assert len(places) > 3
    assert len(np.unique(places, axis=0)) == len(places)
    assert np.hypot(*(places - (nearest, float(runner.state.place.y))).T).min() < 0.04
    save_runner_map(tmp_path, runner, path)
    found = load_map(tmp_path)
    assert found.ndt_cells is None
    assert found.grid == grid
    assert torch.equal(found.cells > 0, grid.inner(runner.state.map.cells) > 0)
    assert (tmp_path / "map.yaml").exists()


def test_the_map_of_a_drive_is_a_building(tmp_path):
    """The walls of a room, ranged from its middle, come back as those of an arena, within a pixel."""
    grid, path, angles = Grid(-3, 3, -3, 3), WalkedPath(), np.linspace(-math.pi, math.pi, 1000)
    reach = 1 / np.maximum(np.abs(np.cos(angles)) / 2.025, np.abs(np.sin(angles)) / 1.525)
    x, y = reach * np.cos(angles), reach * np.sin(angles)
    ranges = Ranges(reach, angles, angles, x, y, np.ones(x.shape, bool))
    path(Step(0, 0.0, None, STAND, STAND, STAND, SimpleNamespace(place=Pose(0.0, 0.0, 0.0), ranges=ranges)))
    cells, row, column = torch.zeros(600, 600), ((y + 3) * 100).astype(int), ((x + 3) * 100).astype(int)
    cells[row, column] = 1.0
    save_map(tmp_path, cells, grid, path.places())
    plan = load_arena(str(tmp_path / "map.yaml"))
    assert plan.bounds == pytest.approx((-2.025, 2.025, -1.525, 1.525), abs=0.05)
    assert plan.outline.area == pytest.approx(4.05 * 3.05, rel=0.06)
    SpawnPoints(plan)
