"""Results of a sweep: what is kept, and what is drawn."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from ndtorch_train.sweep import binding
from ndtorch_train.sweep.config import parse
from ndtorch_train.sweep.parameters import Trial, trial_id
from ndtorch_train.sweep.results import ResultStore, binned, means

DEFAULTS: Trial = {key: p.default for key, p in binding.PARAMETERS.items()}


def trial(**options: Any) -> Trial:
    return DEFAULTS | options


def fake_block(trials: list[Trial], device: str = "cpu") -> list[dict[str, Any]]:
    """In place of a simulation, where only the bookkeeping is tried."""
    return [dict.fromkeys(binding.RESULTS, 0.5) | {"owners": "", "verdict": "stable"} for _ in trials]


def test_a_part_that_was_cut_off_is_run_again(tmp_path: Path) -> None:
    store = ResultStore(tmp_path, "abc")
    trials = [trial(phase=1.0), trial(phase=2.0)]
    for one in trials:
        store.add([one], fake_block([one]))
    part = next(store.parts.iterdir())
    part.write_bytes(part.read_bytes()[:100])
    assert len(store.load()) == 1


def test_a_damaged_table_is_never_believed(tmp_path: Path) -> None:
    """Any byte of it: its rows are as they were, or the file is named and its trials are run again."""
    store, one = ResultStore(tmp_path, "abc"), trial(phase=1.0)
    store.add([one], fake_block([one]))
    part = next(store.parts.iterdir())
    whole, rows, chance, refused = part.read_bytes(), store.load(), random.Random(3), 0
    for _ in range(200):
        damaged = bytearray(whole)
        damaged[chance.randrange(len(whole))] ^= chance.randrange(1, 256)
        part.write_bytes(damaged)
        found = store.load()
        assert found == (rows if not store.damaged else {})
        refused += bool(store.damaged)
    assert refused > 100


def test_processes_of_the_same_number_keep_all_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in containers, where every first process has the number 1."""
    monkeypatch.setattr("os.getpid", lambda: 1)
    trials = [trial(phase=float(k)) for k in range(9)]
    for process in range(3):
        store = ResultStore(tmp_path, "abc")
        for one in trials[process::3]:
            store.add([one], fake_block([one]))
    assert set(store.load()) == set(map(trial_id, trials))


def test_a_part_that_comes_while_the_results_are_written_stays(tmp_path: Path) -> None:
    config = parse({"vary": {"phase": [1, 2]}}, "x", "n")
    ours, theirs = ResultStore(tmp_path, "abc"), ResultStore(tmp_path, "abc")
    ours.add(config.trials[:1], fake_block(config.trials[:1]))
    load = ours.load

    def load_while_another_adds() -> Any:
        found = load()
        theirs.add(config.trials[1:], fake_block(config.trials[1:]))
        return found

    ours.load = load_while_another_adds  # type: ignore[method-assign]
    assert len(ours.finish(config)) == 1
    assert set(theirs.load()) == set(map(trial_id, config.trials))


def test_means_and_bins() -> None:
    rows = [{"a": 1, "v": 1.0}, {"a": 1, "v": 3.0}, {"a": 2, "v": None}]
    assert means(rows, ["a"], "v") == {(1,): (2.0, 2)}
    labels, place = binned([float(k) for k in range(100)])
    assert len(labels) == 12
    assert (place(0.0), place(99.0)) == (0, 11)
    assert binned(["b", "a"])[0] == ["a", "b"]
