"""The guard: how fast it lets a wish through for what is free on its path, and what it does when it stands."""

import contextlib
import json
import math
import threading
from types import SimpleNamespace

import numpy as np
import pytest

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.navigation import Body
from ndtorch.navigation.options import NavigatorOptions
from ndtorch_robot.evaluation import guard as evaluation
from ndtorch_robot.evaluation.guard import BlindDriver, guard_table, judge, true_free
from ndtorch_robot.guard import Guard
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import STAND, DriveCommand
from ndtorch_robot.sim.simulation import RIG
from tests.robot.support.cars import known_step

LENGTH, WIDTH, MARGIN, CELL = 0.5, 0.36, 0.07, 0.08
"""Of the car of [A], and what its controller keeps free around it; side of a cell, m."""


def guarded(places, wish, learned=True, seen=True, pose=(1.0, 2.0, 0.3)):
    """A guard of a car that knows of obstacles at places of its body frame, and that all else is free, or not seen."""
    step, runner = known_step(pose, places or ((-2.0, -2.0),))
    guard, control = Guard(runner, lambda: DriveCommand(*wish)), runner.state.control
    age = guard.control.tables.floor.learning + 1 if learned else 0
    floor = control.floor._replace(age=age, level=np.ones_like(control.floor.level))
    grid = control.grid
    if seen:
        grid = grid._replace(evidence=np.where(grid.evidence > 0, grid.evidence, -2.0).astype(np.float32))
    runner.state = step.state._replace(control=control._replace(floor=floor, grid=grid))
    return guard


@pytest.mark.parametrize("distance", [0.5, 0.7, 0.9, 1.3])
def test_it_stops_within_what_is_free(distance):
    """Reaction and braking fit into the length up to the bumper, its margin and two cells, and not much less."""
    guard = guarded([(distance, 0.0)], (2.0, 0.0))
    speed = guard(STAND).speed
    stops = speed * 0.15 + speed**2 / (2 * 1.5)
    free = distance - LENGTH / 2 - MARGIN
    assert free - 2.5 * CELL <= stops <= free + 0.5 * CELL + 1e-6


@pytest.mark.parametrize(("acceleration", "reaction"), [(0.8, 0.15), (2.5, 0.4)])
def test_it_counts_on_what_the_body_can_do(acceleration, reaction):
    """On no more than .6 of its acceleration, and no quicker than its reaction."""
    guard = guarded([], (2.0, 0.0))
    guard.runner.body = Body(max_acceleration_m_per_s2=acceleration, reaction_s=reaction)
    speed = guard.stops_within(0.5)
    assert 0.45 <= speed * reaction + speed**2 / (2 * 0.6 * acceleration) <= 0.5


def test_a_slower_wish_passes_as_it_is():
    assert guarded([(1.3, 0.0)], (0.2, 1.5))(STAND) == (0.2, 1.5)
    assert guarded([], (0.5, -1.0))(STAND) == (0.5, -1.0)


def test_what_is_beside_the_path_does_not_matter():
    """A post to the left: straight on is free, a curve to the left is not, one to the right is."""
    post = [(0.55, 0.35)]
    assert guarded(post, (1.0, 0.0))(STAND).speed == 1.0
    assert guarded(post, (1.0, 1.5))(STAND).speed < 0.95
    assert guarded(post, (1.0, -1.5))(STAND).speed == 1.0


def test_it_stands_until_enough_is_free_again():
    """Between .1 and .3 m it goes on when it drove, and stands on when it stood."""
    wish = (0.5, 0.0)
    assert guarded([(0.38, 0.0)], wish)(STAND).speed == 0.0
    near = guarded([(0.58, 0.0)], wish)
    assert near(STAND).speed > 0
    near.stopped = True
    assert near(STAND).speed == 0.0
    assert near.stopped
    near.wish = lambda: STAND  # who lets go begins anew
    assert near(STAND) == STAND
    assert not near.stopped


def test_what_stopped_it_blocks_until_it_is_seen_free():
    """What a standing car no longer sees, because it is too near, fades from its memory."""
    guard = guarded([(0.38, 0.0)], (0.5, 0.0))
    assert guard(STAND).speed == 0.0
    for evidence, speed in ((0.0, 0.0), (-2.0, 0.5)):
        state = guard.runner.state
        grid = state.control.grid._replace(evidence=np.full_like(state.control.grid.evidence, evidence))
        guard.runner.state = state._replace(control=state.control._replace(grid=grid))
        assert guard(STAND).speed == speed


def test_into_the_unseen_it_goes_slowly_and_neither_backward_nor_around_a_corner():
    assert guarded([], (0.6, 0.0), seen=False)(STAND).speed == 0.3
    assert guarded([], (-0.3, 0.0))(STAND).speed == -0.3
    for wish in ((-0.3, 0.0), (0.3, 1.5)):
        blind = guarded([], wish, seen=False)
        assert blind(STAND).speed == 0.0
        assert blind.stopped


def test_before_the_floor_is_known_it_drives_straight_as_the_controller_does():
    guard = guarded([], (0.3, 1.0), learned=False)
    assert guard(DriveCommand(0.5, 0.0)) == (0.3, 0.0)
    assert guard(STAND) == STAND  # the controller has too little room to begin
    assert guard.stopped
    guard.wish = lambda: DriveCommand(-0.3, 0.0)
    assert guard(DriveCommand(0.5, 0.0)) == STAND
    age = guard.runner.state.control.floor.age
    assert age <= guard.control.tables.floor.standing


def test_without_a_state_it_stands():
    guard = guarded([], (0.3, 0.0))
    guard.runner.state = None
    assert guard(DriveCommand(0.5, 0.0)) == STAND


def test_it_needs_the_controller_that_sees_floor():
    runner = NavigatorRunner(NavigatorOptions(controller="published"), RIG, 30.0)
    with pytest.raises(InputError, match="a guard sees with the controller 'ranging', got 'published'"):
        Guard(runner, lambda: STAND)


def test_the_truth_is_where_the_car_first_touches():
    """A wall at x = 1, for a car of half a metre; a curve ends where the arc crosses it."""
    simulation = SimpleNamespace(touches=lambda pose: pose[0] + LENGTH / 2 > 1.0)
    assert true_free(simulation, (0.0, 0.0, 0.0), DriveCommand(0.3, 0.0)) == pytest.approx(0.75, abs=0.041)
    assert true_free(simulation, (0.0, 0.0, 0.0), DriveCommand(-0.3, 0.0)) == 1.0
    arc = math.asin(0.75 * 1.25) / 1.25  # x = sin(k s) / k
    assert true_free(simulation, (0.0, 0.0, 0.0), DriveCommand(0.3, 1.25)) == pytest.approx(min(arc, 1.0), abs=0.041)


def test_shares_are_counted_of_the_steps_they_are_of():
    ahead, fast, slow = DriveCommand(0.5, 0.0), DriveCommand(0.5, 0.0), DriveCommand(0.2, 0.0)
    free = [1.0, 0.9, 0.4, 0.3, 0.25, 0.05, 0.05, 0.8]
    sent = [fast, STAND, fast, slow, slow, STAND, slow, fast]
    found = judge(free, [ahead] * 8, sent, 30.0)
    assert (found["must_stop"], found["held"], found["may_go"], found["false_stops"]) == (2, 1, 3, 1)
    assert (found["stop_s"], found["stop_m"]) == ([0.067], [0.05])
    summary = {"arena": "a", "seed": 1, "seconds": 1800.0, "hits": 2, "distance_m": 3.0}
    assert "| all | 4 | 0.500 | 0.333 | 0.07 | 0.05 |" in guard_table([summary | found])


def test_the_blind_driver_is_drawn_by_its_seed():
    first, again, other = (BlindDriver(seed, 30.0) for seed in (3, 3, 4))
    wishes = [first() for _ in range(600)]
    assert wishes == [again() for _ in range(600)]
    assert wishes != [other() for _ in range(600)]
    assert {wish.speed < 0 for wish in wishes} == {True, False}
    assert all(abs(wish.curvature) <= 2 and -0.2 <= wish.speed <= 0.6 for wish in wishes)


def test_a_car_is_steered_by_the_guard_and_its_bridges_give_the_wish(monkeypatch, tmp_path, capsys):
    """A car that takes one step; the gamepad is a file, which is at its end: gone, which ends the bridge alone."""
    (tmp_path / "js0").touch()
    file = tmp_path / "car.toml"
    file.write_text(f'robot = "x"\n[simulation]\n[bridges.gamepad]\ndevice = "{tmp_path / "js0"}"\n')
    step, runner = known_step()
    car = SimpleNamespace(runner=runner, safe=None, ended=threading.Event(), observers=[], steer=None)
    steered = []

    def run(seconds):
        steered.append(car.steer)
        for observer in car.observers:
            observer(step)

    car.run, car.summary = run, lambda: {"steps": 1}
    monkeypatch.setattr("ndtorch_robot.run.open_car", lambda *_, go: contextlib.nullcontext(car))
    monkeypatch.setattr("ndtorch_robot.run.real_time_priority", lambda report: None)
    monkeypatch.setattr("ndtorch_robot.emergency.emergency_stops", lambda *_: contextlib.nullcontext())
    assert main(["guard", str(file), "--seconds", "1"]) == 0
    assert isinstance(steered[0], Guard)
    (thread,) = car.observers
    assert thread.bridge.wish is steered[0].wish
    assert json.loads(capsys.readouterr().out) == {"steps": 1}


def test_arenas_are_judged_once_and_kept(monkeypatch, tmp_path, capsys):
    made = []

    def drive(config, report, guarded):
        made.append((config.arena, config.seed, config.seconds, guarded))
        found = {"arena": config.arena, "seed": config.seed, "seconds": config.seconds, "hits": 1}
        counts = {"must_stop": 4, "held": 3, "may_go": 10, "false_stops": 1, "stop_s": [0.2], "stop_m": [0.1]}
        return found | counts

    def finish(work, given, cache, *_):
        for config in given:
            if cache.get(config) is None:
                cache.put(config, work(config, lambda seconds: None))
        return []

    monkeypatch.setattr(evaluation, "guarded_drive", drive)
    monkeypatch.setattr("ndtorch_robot.evaluation.drives.finish", finish)
    words = ["guard", "--arenas", "office", "hallway", "--seeds", "1", "--seconds", "30", "--out", str(tmp_path)]
    for _ in range(2):
        assert main(words) == 0
    assert made == [("office", 1, 30.0, True), ("hallway", 1, 30.0, True)]
    table = (tmp_path / "table.md").read_text()
    assert "| all | 120 | 0.750 | 0.100 | 0.20 | 0.10 |" in table
    assert table in capsys.readouterr().out
    assert main([*words, "--unguarded"]) == 0
    assert made[2:] == [("office", 1, 30.0, False), ("hallway", 1, 30.0, False)]
    assert "| all, unguarded | 120 | 0.750 | 0.100 | 0.20 | 0.10 |" in (tmp_path / "table.md").read_text()
