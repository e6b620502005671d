"""`ndtorch guard`: what it refuses, how it is wired, and its table."""

import contextlib
import json
import threading
from types import SimpleNamespace

from ndtorch.cli.commands import main
from ndtorch_robot.evaluation import guard as evaluation
from ndtorch_robot.guard import Guard
from tests.robot.support.known_state import known_step


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
