"""Sweeps: batches that give what single trials give, restarts, and what goes wrong."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from ndtorch.commands import main
from ndtorch.errors import InputError
from ndtorch_train.sweep import binding, driving
from ndtorch_train.sweep.config import Trial, parse, trial_id
from ndtorch_train.sweep.results import ResultStore, binned, means, read

DEFAULTS: Trial = {key: p.default for key, p in binding.PARAMETERS.items()}


def trial(**options: Any) -> Trial:
    return DEFAULTS | options


@pytest.mark.slow
def test_a_batch_gives_what_single_trials_give() -> None:
    """And the right answers: two bars at 290° are found, a Hebbian network and bars in phase are not."""
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
    rows = read(out / "results.parquet")
    assert [(row["gamma"], row["phase"]) for row in rows] == [(0.5, 60.0), (0.5, 90.0), (1.0, 60.0), (1.0, 90.0)]
    assert list((out / "parts").iterdir()) == []
    assert {path.name for path in out.glob("*.*")} >= {"summary.md", "summary.json", "heatmap-success.png"}
    assert json.loads((out / "summary.json").read_text())["trials"] == 4
    assert "| gamma | 0.5 | 2 | 0.5 |" in (out / "summary.md").read_text()


def test_trials_of_other_code_do_not_count(
    tmp_path: Path, in_process: list[int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = write_sweep(tmp_path / "s.toml", [0.5]), tmp_path / "out"
    assert main(["sweep", str(file), "--out", str(out), "--jobs", "1"]) == 0
    monkeypatch.setattr(binding, "USES", ("train/ndtorch_train/workers.py",))
    assert main(["sweep", str(file), "--out", str(out), "--jobs", "1"]) == 0
    assert sum(in_process) == 4
    assert "2 trials" in (err := capsys.readouterr().err)
    assert "other code" in err


def test_a_part_that_was_cut_off_is_run_again(tmp_path: Path) -> None:
    store = ResultStore(tmp_path, "abc")
    trials = [trial(phase=1.0), trial(phase=2.0)]
    for one in trials:
        store.add([one], fake_block([one]))
    parts = sorted(store.parts.iterdir())
    parts[0].write_bytes(parts[0].read_bytes()[:100])
    assert list(store.load()) == [trial_id(trials[1])]


def test_blocks_that_fail_are_reported_and_the_rest_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def events(function: Any, tasks: Any, jobs: int) -> Any:
        yield "again", 0, -9
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

    monkeypatch.setattr("ndtorch_train.sweep.results.write", full)
    file = write_sweep(tmp_path / "s.toml", [0.5])
    assert main(["sweep", str(file), "--out", str(tmp_path / "out"), "--jobs", "1"]) == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith("cannot be written: No space left on device")


def test_without_ray_it_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    file = write_sweep(tmp_path / "s.toml", [0.5])
    assert main(["sweep", str(file), "--out", str(tmp_path / "out"), "--cluster"]) == 2
    assert "pip install 'ndtorch[cluster]'" in capsys.readouterr().err


def test_means_and_bins() -> None:
    rows = [{"a": 1, "v": 1.0}, {"a": 1, "v": 3.0}, {"a": 2, "v": None}]
    assert means(rows, ["a"], "v") == {(1,): (2.0, 2)}
    labels, place = binned([float(k) for k in range(100)])
    assert len(labels) == 12
    assert (place(0.0), place(99.0)) == (0, 11)
    assert binned(["b", "a"])[0] == ["a", "b"]


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
