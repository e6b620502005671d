"""The command that sweeps: restarts, and what goes wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pyarrow.parquet
import pytest

from ndtorch.cli.commands import main
from ndtorch_train.sweep import binding
from ndtorch_train.sweep.parameters import Trial


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
