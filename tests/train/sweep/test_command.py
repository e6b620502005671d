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


@pytest.mark.parametrize("after", [0, 1])
def test_a_stopped_sweep_tells_what_it_keeps(
    after: int,
    tmp_path: Path,
    in_process: list[int],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def stopped(function: Any, tasks: Any, jobs: int) -> Any:
        for n, task in enumerate(tasks[:after]):
            yield "done", n, fake_block(task)
        raise KeyboardInterrupt

    file, out = write_sweep(tmp_path / "s.toml", [0.5, 1.0]), tmp_path / "out"
    command = ["sweep", str(file), "--out", str(out), "--jobs", "2"]
    with monkeypatch.context() as own:
        own.setattr("ndtorch_train.sweep.command.run_tasks", stopped)
        assert main(command) == 130
    told = capsys.readouterr().err
    assert (
        f"stopped; {out} keeps 2 of 4 trials, and the same command goes on with the others\n" in told
        if after
        else ("stopped before there was anything to keep\n" in told)
    )
    assert main(command) == 0
    assert sum(in_process) == (2 if after else 4)


def test_a_finished_sweep_keeps_what_was_told_of_its_run(
    tmp_path: Path, in_process: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = write_sweep(tmp_path / "s.toml", [0.5]), tmp_path / "out"
    again = ["sweep", str(file), "--out", str(out), "--jobs", "1"]
    assert main(again) == 0
    first = (out / "summary.json").read_text()
    assert json.loads(first)["computed now"] == 2
    capsys.readouterr()
    assert main([*again, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(first)
    assert (out / "summary.json").read_text() == first
    # What cannot be read, or is of other trials, is no summary.
    for broken in ("[1]", "{", '{"trials": 7}'):
        (out / "summary.json").write_text(broken)
        assert main(again) == 0
        assert json.loads((out / "summary.json").read_text())["trials"] == 2
    assert sum(in_process) == 2


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


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--out", "/proc/nowhere"], "cannot write there"),
        (["--jobs", "0"], "--jobs must be at least 1"),
        (["--cluster", "a", "b"], "takes one address"),
    ],
)
def test_options_that_cannot_be_used(
    tmp_path: Path, options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_sweep(tmp_path / "s.toml", [0.5])
    given = [] if "--out" in options else ["--out", str(tmp_path / "out")]
    assert main(["sweep", str(file), *given, *options]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1


def test_a_full_disk_is_one_line(
    tmp_path: Path, in_process: list[int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("ndtorch_train.sweep.command.write_text", full)
    file = write_sweep(tmp_path / "s.toml", [0.5])
    assert main(["sweep", str(file), "--out", str(tmp_path / "out"), "--jobs", "1"]) == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith("cannot be written: No space left on device")
