"""Walking through a car, and driving it: what is asked, and what is said of it."""

from __future__ import annotations

import json
import signal

import numpy as np
import pytest

import ndtorch_robot.car
from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.utils import workers
from ndtorch.utils.signals import ended_like_ctrl_c
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.drive import check_goal
from ndtorch_robot.sim.arenas import load_arena
from tests.robot.test_barn import FILE as TWO_WORLDS

MAPS = ["map.npz", "map.pgm", "map.png", "map.yaml"]
PICTURES = ["map.png", "path.png"]
FILES = [*MAPS, "path.png", "report.html", "summary.json"]
KEYS = {
    *("collisions", "stopped", "simulated_seconds", "wall_seconds", "distance_m", "turns"),
    *("step_ms", "map", "arena", "seed", "controller"),
}


def test_json(tmp_path, capsys):
    config = tmp_path / "drive.toml"
    config.write_text('arena = "room"\nseconds = 9\nseed = 3\n')
    assert main(["drive", str(config), "--seconds", "3", "--out", str(tmp_path / "out"), "--json"]) == 0
    out, err = capsys.readouterr()
    summary = json.loads(out)
    assert summary.keys() >= KEYS
    assert set(summary["map"]) == {"precision", "surfaces", "recall", "position_error_cm", "spacing_error_percent"}
    assert summary["step_ms"].keys() >= {"p50", "p99"}
    assert (summary["arena"], summary["seed"], summary["simulated_seconds"]) == ("room", 3, 3.0)
    assert [line for line in err.splitlines() if not line.startswith("note: ")] == []  # a first start compiles
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == FILES
    assert json.loads((tmp_path / "out" / "summary.json").read_text()) == summary
    saved = np.load(tmp_path / "out" / "map.npz")
    assert saved["cells"].max() == pytest.approx(1.0)
    assert saved["true_path"].shape == saved["located_path"].shape == (90, 3)


@pytest.mark.slow
def test_a_map_is_made_and_known_again(tmp_path, capsys):
    shared = ["drive", "--arena", "room", "--seconds", "1", "--odometry", "noisy"]
    assert main([*shared, "--localise", "--out", str(tmp_path / "first")]) == 0
    assert "error of the pose at the end: dead reckoning 0.0" in capsys.readouterr().out
    made = tmp_path / "first" / "map.npz"
    assert np.load(made)["walls"].shape[1] == 8
    assert main([*shared, "--known-map", str(made), "--out", str(tmp_path / "second")]) == 0
    assert "error of the pose at the end" in capsys.readouterr().out
    assert main([*shared, "--known-map", str(tmp_path)]) == 2
    assert "map" in capsys.readouterr().err


def test_sigterm_leaves_the_pictures_out(tmp_path, capsys, monkeypatch):
    step = ndtorch_robot.car.Car.step

    def interrupted(self, number, now):
        if number == 20:
            signal.raise_signal(signal.SIGTERM)
        step(self, number, now)

    monkeypatch.setattr(ndtorch_robot.car.Car, "step", interrupted)
    with ended_like_ctrl_c():
        assert main(["drive", "--out", str(tmp_path)]) == 130
    assert "(interrupted)" in capsys.readouterr().out
    assert sorted(p.name for p in tmp_path.iterdir()) == [name for name in FILES if name not in PICTURES]


def test_a_goal_outside_of_the_building_or_in_a_wall_is_refused() -> None:
    plan = load_arena("room", 100)
    left, right, bottom, top = plan.bounds
    places = np.random.default_rng(0).uniform((left, bottom), (right, top), (200, 2))
    free = places[plan.clearance(places).argmax()]
    check_goal(DriveConfig(arena="room", controller="goal", goal="{:.2f},{:.2f}".format(*free)), plan)
    check_goal(DriveConfig(arena="room", controller="goal"), plan)
    for x, y in ((right + 3, 0.0), (left - 40, bottom - 40), (right, top)):
        with pytest.raises(InputError, match="no free place of room"):
            check_goal(DriveConfig(arena="room", controller="goal", goal=f"{x},{y}"), plan)


WORLDS = [{"world": n, "path_m": 10.0, "cylinders": [[2.0, 4.0]]} for n in (4, 5, 6)]
FILE = {**TWO_WORLDS, "worlds": WORLDS}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "worlds.json"
    path.write_text(json.dumps(FILE))
    return path


@pytest.fixture
def driven(monkeypatch):
    """The entries that would have been driven: the car touches something in world 6 and cannot be driven in world 5."""
    entries = []

    def run(function, tasks, jobs):
        for n, entry in enumerate(tasks):
            entries.append(entry)
            number = entry[0].worlds[0].world
            if number == 5 and entry[1].seed == 0:
                yield workers.Event("failed", n, "Traceback\n  in a file\nInputError: no OpenGL\n")
                continue
            hit = number == 6
            result = {"world": number, "success": not hit, "collided": hit, "time_s": 20.0, "score": 0.25 * (not hit)}
            yield workers.Event("done", n, result)

    monkeypatch.setattr(workers, "run_tasks", run)
    return entries


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--worlds", "9"], "has no world 9 among those of --split all"),
        (["--split", "test", "--worlds", "4"], "has no world 4 among those of --split test"),
        (["--jobs", "-1"], "--jobs must be 1 or more, got -1"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_driven(arguments, message, file, driven, capsys):
    assert main(["barn", str(file), "--out", str(file.parent / "out"), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert driven == []
    assert not (file.parent / "out").exists()


def test_ctrl_c_keeps_what_was_finished(file, monkeypatch, driven, capsys):
    whole = workers.run_tasks

    def cut(*arguments):
        yield next(iter(whole(*arguments)))
        raise KeyboardInterrupt

    monkeypatch.setattr(workers, "run_tasks", cut)
    out = file.parent / "out"
    assert main(["barn", str(file), "--out", str(out)]) == 130
    assert (out / "barn.csv").read_text().splitlines()[1:] == ["4,True,False,20.0,0.25"]
    assert "2 of 3 worlds are missing" in capsys.readouterr().out
