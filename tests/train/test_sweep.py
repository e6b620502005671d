"""Sweeps: their files, their trials and the command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.utils.packages import folder_of
from ndtorch_train.superposed import Bars
from ndtorch_train.sweep import binding, driving
from ndtorch_train.sweep.config import parse, read_sweep
from ndtorch_train.sweep.parameters import Trial, trial_id

SWEEPS = folder_of("ndtorch_train", "sweeps")


def test_a_grid_is_every_combination() -> None:
    config = parse(
        {"vary": {"phase": [10, 20.0], "gamma": {"from": 0.1, "to": 10, "steps": 3, "scale": "log"}}}, "x", "n"
    )
    assert [(t["phase"], t["gamma"]) for t in config.trials] == [
        (10.0, 0.1), (10.0, 1.0), (10.0, 10.0), (20.0, 0.1), (20.0, 1.0), (20.0, 10.0)
    ]  # fmt: skip
    assert config.trials[0]["rule"] == "competitive"
    assert config.show == ("phase", "gamma", "", ("success",))


def test_equal_trials_are_run_once() -> None:
    assert len(parse({"vary": {"phase": [10, 10.0, 20]}}, "x", "n").trials) == 2


def test_a_random_sweep_is_the_same_every_time() -> None:
    data = {
        "method": "random", "trials": 40, "seed": 3,
        "vary": {"phase": {"from": 30, "to": 60}, "bars": {"from": 1, "to": 3}, "rule": ["hebbian", "competitive"],
                 "gamma": {"from": 0.1, "to": 10, "scale": "log"}},
    }  # fmt: skip
    config, again = parse(data, "x", "n"), parse(data, "x", "n")
    assert config.trials == again.trials
    assert len(config.trials) == 40
    assert {t["bars"] for t in config.trials} == {1, 2, 3}
    assert {t["rule"] for t in config.trials} == {"hebbian", "competitive"}
    assert all(30 <= float(t["phase"]) <= 60 and 0.1 <= float(t["gamma"]) <= 10 for t in config.trials)
    assert parse(data | {"seed": 4}, "x", "n").trials != config.trials


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"vary": {"gama": [1]}}, "unknown key 'gama'; did you mean gamma?"),
        ({"varry": {"gamma": [1]}}, "unknown key 'varry'; did you mean vary?"),
        ({}, "no trial"),
        ({"vary": {"gamma": {"from": 1, "to": 2, "steps": 0}}}, "no trial"),
        ({"method": "random", "trials": 5, "vary": {"gamma": []}}, "no trial"),
        ({"method": "best", "vary": {"gamma": [1]}}, "method = 'best': should be 'grid' or 'random'"),
        ({"vary": {"gamma": [-1]}}, "gamma must lie in"),
        ({"kind": "driving", "vary": {"reach": [10**400]}}, "reach must lie in"),
        ({"vary": {"gamma": ["fast"]}}, "gamma must be a number"),
        ({"vary": {"bars": [1.5]}}, "bars must be a whole number"),
        ({"vary": {"rule": ["hebb"]}}, "rule must be one of competitive"),
        ({"vary": {"gamma": 3}}, "must be a list or"),
        ({"vary": {"gamma": {"from": 1, "to": 2, "steps": 2**63}}}, "gamma: steps"),
        ({"vary": {"gamma": {"from": 1, "to": 3}}}, "gamma needs steps"),
        ({"vary": {"gamma": {"from": 0, "to": 3, "steps": 2, "scale": "log"}}}, "positive on a logarithmic"),
        ({"vary": {"gamma": [1]}, "fixed": {"gamma": 2}}, "both in"),
        ({"vary": {"gamma": [1]}, "show": {"x": "phase"}}, "does not vary"),
        ({"vary": {"gamma": [1]}, "show": {"values": ["sucess"]}}, "must be some of success"),
        (
            {"vary": {"gamma": {"from": 0, "to": 1, "steps": 2000}, "phase": {"from": 0, "to": 1, "steps": 2000}}},
            "most",
        ),
    ],
)
def test_what_cannot_be_used_is_named(data: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=r"^file\.toml") as error:
        parse(data, "file.toml", "file")
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_sweep(tmp_path / "missing.toml")
    (tmp_path / "bad.toml").write_text("a = [")
    with pytest.raises(InputError, match="not a TOML file"):
        read_sweep(tmp_path / "bad.toml")


def test_the_sweeps_that_ship() -> None:
    binding, maps = read_sweep(SWEEPS / "binding.toml"), read_sweep(SWEEPS / "maps.toml")
    assert len(binding.trials) >= 2000
    assert {t["seconds"] for t in binding.trials} == {15.0}
    assert len({trial_id(t) for t in maps.trials}) == len(maps.trials) == 280


DEFAULTS: Trial = {key: p.default for key, p in binding.PARAMETERS.items()}


def trial(**options: Any) -> Trial:
    return DEFAULTS | options


@pytest.mark.slow
def test_a_batch_gives_what_single_trials_give(bars: Bars, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the right answers: two bars at 290° are found, a Hebbian network and bars in phase are not."""
    monkeypatch.setattr(binding, "film", lambda: bars)  # as it films them, once for all tests
    trials = [trial(), trial(phase=0.0), trial(gamma=0.0), trial(bars=1), trial(bars=3), trial(noise=0.05, seed=7)]
    together = binding.run_block(trials)
    assert [r["owners"] for r in together][:1] == ["red+green"]
    assert [r["success"] for r in together] == [1.0, 0.0, 0.0, 1.0, 1.0, together[5]["success"]]
    assert together[1]["verdict"] == "learning"
    assert together[2]["largest"] == 0.0
    for one in (0, 5):
        alone = binding.run_block([trials[one]])[0]
        assert alone["owners"] == together[one]["owners"]
        assert alone["largest"] == pytest.approx(together[one]["largest"], rel=1e-3)


def test_blocks_hold_what_can_be_computed_together() -> None:
    trials = [trial(phase=float(p), rule=r) for p in range(5) for r in ("competitive", "hebbian")]
    blocks = binding.blocks(trials, 1, 3)
    assert sorted(len(block) for block in blocks) == [2, 2, 3, 3]
    assert all(len({t["rule"] for t in block}) == 1 for block in blocks)
    assert sorted(trial_id(t) for block in blocks for t in block) == sorted(map(trial_id, trials))
    drives = [{key: p.default for key, p in driving.PARAMETERS.items()} | {"reach": r, "seed": s}
              for r in (1.0, 2.0) for s in (0, 1)]  # fmt: skip
    assert [len(block) for block in driving.blocks(drives, 4)] == [2, 2]


def test_a_driving_trial_knows_which_thresholds_it_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: dict[str, Any] = {}

    def record(options: Any, progress: Any = None, thresholds: Any = None) -> None:
        seen.update(options=options, thresholds=thresholds)
        raise InputError("enough")

    monkeypatch.setattr(driving, "record_drive", record)
    config = parse({"kind": "driving", "vary": {"turn_threshold": [0.3]}, "fixed": {"arena": "loop"}}, "x", "n")
    with pytest.raises(InputError, match="enough"):
        driving.run_block(config.trials)
    assert seen["thresholds"] == {"turn_threshold": 0.3}
    assert seen["options"]["arena"] == "loop"


def fake_block(trials: list[Trial], device: str = "cpu") -> list[dict[str, Any]]:
    """In place of a simulation, where only the bookkeeping is tried."""
    return [dict.fromkeys(binding.RESULTS, 0.5) | {"owners": "", "verdict": "stable"} for _ in trials]


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Blocks are computed here, not in processes; returns the sizes of those that were asked for."""
    asked: list[int] = []

    def events(function: Any, tasks: Any, jobs: int) -> Any:
        for n, task in enumerate(tasks):
            asked.append(len(task))
            yield "done", n, fake_block(task)

    monkeypatch.setattr("ndtorch_train.sweep.command.run_tasks", events)
    return asked


def read(path: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = pyarrow.parquet.read_table(path).to_pylist()
    return rows


def write_sweep(path: Path, gammas: list[float]) -> Path:
    path.write_text(f"[vary]\ngamma = {gammas}\nphase = [60, 90]\n")
    return path


def test_a_sweep_goes_on_where_it_was(
    tmp_path: Path, in_process: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = write_sweep(tmp_path / "s.toml", [0.5]), tmp_path / "out"
    assert main(["sweep", str(file), "--out", str(out), "--jobs", "1"]) == 0
    assert sum(in_process) == 2
    write_sweep(file, [0.5, 1.0])
    assert main(["sweep", str(file), "--out", str(out), "--jobs", "1"]) == 0
    assert sum(in_process) == 4
    assert "2 of 4 trials were finished before" in capsys.readouterr().out
    assert len(read(out / "results.parquet")) == 2
    first, out = out, tmp_path / "out-2"
    rows = read(out / "results.parquet")
    assert [(row["gamma"], row["phase"]) for row in rows] == [(0.5, 60.0), (0.5, 90.0), (1.0, 60.0), (1.0, 90.0)]
    assert {path.name for path in out.glob("*.*")} >= {"summary.md", "summary.json", "heatmap-success.png"}
    assert json.loads((out / "summary.json").read_text())["trials"] == 4
    assert "| gamma | 0.5 | 2 | 0.5 |" in (out / "summary.md").read_text()
    # Started again it has nothing left to do; anew, it takes a folder of its own.
    assert main(["sweep", str(file), "--out", str(first), "--jobs", "1"]) == 0
    assert sum(in_process) == 4
    assert main(["sweep", str(file), "--out", str(first), "--jobs", "1", "--fresh"]) == 0
    assert sum(in_process) == 8
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "out-2", "out-3", "s.toml"]


def test_trials_of_other_code_do_not_count(
    tmp_path: Path, in_process: list[int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = write_sweep(tmp_path / "s.toml", [0.5]), tmp_path / "out"
    assert main(["sweep", str(file), "--out", str(out), "--jobs", "1"]) == 0
    monkeypatch.setattr(binding, "USES", ("ndtorch.utils.workers",))
    assert main(["sweep", str(file), "--out", str(out), "--jobs", "1"]) == 0
    assert sum(in_process) == 4
    assert "2 trials" in (err := capsys.readouterr().err)
    assert "other code" in err


def test_blocks_that_fail_are_reported_and_the_rest_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def events(function: Any, tasks: Any, jobs: int) -> Any:
        yield "again", 0, "SIGKILL"
        yield "failed", 0, "its worker died 3 times"
        yield "done", 1, fake_block(tasks[1])

    monkeypatch.setattr("ndtorch_train.sweep.command.run_tasks", events)
    file = write_sweep(tmp_path / "s.toml", [0.5])
    assert main(["sweep", str(file), "--out", str(tmp_path / "out"), "--jobs", "2"]) == 1
    err = capsys.readouterr().err
    assert "its 1 trials are run again" in err
    assert "its worker died 3 times" in err
    assert len(read(tmp_path / "out" / "results.parquet")) == 1
