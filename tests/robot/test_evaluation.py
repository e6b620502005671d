"""Many drives: the cache, the table, the command; metrics of maps."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from ndtorch.cli.commands import main
from ndtorch.navigation import Grid, StereoRig
from ndtorch.utils import workers
from ndtorch.utils.workers import Event
from ndtorch_robot.config import DriveConfig
from ndtorch_robot.evaluation.drives import key_of
from ndtorch_robot.evaluation.metrics import MapScore, score_map, true_edges, visible
from ndtorch_robot.evaluation.record import Record
from ndtorch_robot.sim.arenas import Box, trace
from ndtorch_robot.sim.plan import Plan, cylinder
from ndtorch_robot.sim.textures import ALONG

MAP = ("precision", "recall", "position_error_cm", "spacing_error_percent", "surfaces")


def summary(arena="room", seed=1, controller="published", **changes):
    values = {
        "arena": arena,
        "controller": controller,
        "seed": seed,
        "simulated_seconds": 900.0,
        "collisions": 2,
        "stopped": 1,
        "distance_m": 400.0,
        "free_area_passed": 0.5,
        "map": dict(zip(MAP, (0.8, 0.6, 1.5, None, 0.9), strict=True)),
    }
    return values | changes


def test_key_names_what_a_drive_depends_on(tmp_path):
    config = DriveConfig()
    assert key_of(config) == key_of(replace(config, out=tmp_path, rrd=tmp_path / "d.rrd"))
    arena, robot = tmp_path / "my.toml", tmp_path / "robot.toml"
    for file in (arena, robot):
        file.write_text("first")
    changed = [{"seed": 3}, {"seconds": 61.0}, {"arena": "room"}, {"arena": str(arena)}]
    changed.append({"robot": robot})
    keys = [key_of(replace(config, **change)) for change in ({}, *changed)]
    assert len(set(map(str, keys))) == len(changed) + 1
    for file, change in ((arena, {"arena": str(arena)}), (robot, {"robot": robot})):
        file.write_text("second")
        assert key_of(replace(config, **change)) not in keys


def test_command_goes_on_where_it_was(tmp_path, capsys, monkeypatch):
    folder, driven = tmp_path / "e", []

    def run(work, tasks, jobs):
        for number, task in enumerate(tasks):
            driven.append(task.seed)
            yield Event("done", number, summary("room", task.seed))

    monkeypatch.setattr(workers, "run_tasks", run)
    arguments = ["evaluate", "--arenas", "room", "--seconds", "1", "--jobs", "1", "--out", str(folder)]
    arguments += ["--controllers", "published", "--seeds", "1000", "1001"]
    assert main(arguments) == 0
    assert "| room | published | 2 |" in capsys.readouterr().out
    lines = [json.loads(line) for line in (folder / "drives.jsonl").read_text().splitlines()]
    assert [line["seed"] for line in lines] == [1000, 1001]
    min((folder / "drives").iterdir()).unlink()
    assert main([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["drives"] == 2
    assert len(driven) == 3


RIG = StereoRig()


def doors():
    """A hallway with three niches 1.5 m apart; the doors are dark, all else is bright."""
    niches = [Box(2 + 1.5 * k, 1.0, 2.9 + 1.5 * k, 1.1, "door") for k in range(3)]
    outline, solids = trace([Box(0, -1, 9, 1), *niches])
    rows = (tuple((2 + 1.5 * k, 1.0) for k in range(3)),)
    plan = Plan("test", outline, solids, doors=rows)
    ends = np.roll(outline.array, -1, 0)
    profiles = [
        np.full(round(float(np.hypot(*(b - a))) * ALONG), 0.2 if kind == "door" else 0.8)
        for a, b, kind in zip(outline.array, ends, outline.kinds, strict=True)
    ]
    return plan, profiles


def blob(grid, places, spread=0.01):
    """A map with a small round blob at each place."""
    row, column = torch.meshgrid(torch.arange(grid.rows), torch.arange(grid.columns), indexing="ij")
    x, y = grid.center(row, column)
    return sum(torch.exp(-((x - a) ** 2 + (y - b) ** 2) / (2 * spread**2)) for a, b in places)


def test_true_edges():
    plan, profiles = doors()
    edges = true_edges(plan, profiles, 0.2)
    # Each niche: two corners at its front, and two at its back, where the door meets the jambs.
    assert len(edges.places) == 12
    assert edges.faint.sum() == 6
    assert set(np.round(edges.places[edges.faint][:, 1], 6)) == {1.0}


def test_visible():
    plan, profiles = doors()
    edges = true_edges(plan, profiles, 0.2)
    poses = np.array([(x, 0.0, 0.0) for x in np.arange(0, 2.0, 0.05)])
    seen = edges.places[visible(plan, edges, poses, RIG)]
    assert {(round(x, 2), round(y, 2)) for x, y in seen} == {(2.0, 1.0), (2.9, 1.1), (3.5, 1.0)}
    assert not visible(plan, edges, np.add(poses, (0, 0, np.pi)), RIG).any()


def test_a_good_and_a_bad_map():
    plan, profiles = doors()
    grid = Grid(-0.5, 9.5, -1.5, 1.6)
    poses = np.array([(x, 0.0, 0.0) for x in np.arange(0, 7.0, 0.05)])
    edges = true_edges(plan, profiles, 0.2)
    seen = edges.places[visible(plan, edges, poses, RIG)]
    perfect = score_map(blob(grid, seen), grid, plan, profiles, poses, RIG)
    assert perfect.precision == pytest.approx(1.0, abs=1e-3)
    assert perfect.recall == 1.0
    assert perfect.position_error_cm < 1.0
    assert perfect.spacing_error_percent < 0.7
    stretched = score_map(blob(grid, seen * (1.02, 1.0)), grid, plan, profiles, poses, RIG)
    assert stretched.spacing_error_percent == pytest.approx(2.0, abs=0.7)
    assert 3.0 < stretched.position_error_cm < 12.0
    wrong = score_map(blob(grid, [(4.0, 0.0)]), grid, plan, profiles, poses, RIG)
    assert wrong.precision == pytest.approx(0.0, abs=1e-6)
    assert wrong.recall == 0.0
    assert wrong.position_error_cm is None
    empty = score_map(torch.zeros(grid.rows, grid.columns), grid, plan, profiles, poses, RIG)
    assert empty == MapScore()


def test_a_map_of_places_along_walls():
    """It lies on surfaces, of which few places are edges; what hangs or lies below the cameras is none of them."""
    plan, profiles = doors()
    grid, poses = Grid(-0.5, 9.5, -1.5, 1.6), np.zeros((1, 3))
    along = [(x, -1.0) for x in (1.0, 2.0, 4.0)]
    wall = score_map(blob(grid, along), grid, plan, profiles, poses, RIG)
    assert wall.precision == pytest.approx(0.0, abs=1e-6)
    assert wall.surfaces == pytest.approx(1.0, abs=1e-3)
    for height, share in ((1.0, 1.0), (0.15, 0.0)):
        pole = replace(plan, solids=(*plan.solids, cylinder(4.0, 0.0, 0.05, height)))
        more = [*profiles, *(np.full(10, 0.5) for _ in pole.solids[-1].points)]
        found = score_map(blob(grid, [(4.0, 0.0)]), grid, pole, more, poses, RIG)
        assert found.surfaces == pytest.approx(share, abs=1e-3)


def test_turns_are_counted_when_they_begin():
    made = object.__new__(Record)
    for commands, turns in (
        ([(0.5, 0), (0.5, 1), (0.4, 2), (0.5, 0), (0.5, 1)], 2),  # a turn that gets tighter is one
        ([(0.5, 1), (0.5, -1)], 2),
        ([(0.5, 0), (-0.3, 1.9), (-0.3, 1.6), (-0.3, 1.3), (0.5, 0)], 0),  # back on the way it came
        ([], 0),
    ):
        made.values = {"command": commands}
        assert made.turns == turns
