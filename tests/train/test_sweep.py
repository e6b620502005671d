"""Sweeps: their files, their trials, and a whole one that continues."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas
import pytest

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch.utils.toml import toml_values
from ndtorch_train.superposed import Stimuli
from ndtorch_train.sweep import trials
from ndtorch_train.sweep.command import read_sweep
from ndtorch_train.sweep.trials import BindingTrial, run_block

SWEEPS = Path(__file__).parents[2] / "train/sweeps"


def test_grid() -> None:
    data = {"vary": {"phase": [10, 20.0], "gamma": {"from": 0.1, "to": 10, "steps": 3, "scale": "log"}}}
    found = read_sweep(data, "x")[1]
    assert [(t.phase, t.gamma) for t in found] == [(10, 0.1), (10, 1), (10, 10), (20, 0.1), (20, 1), (20, 10)]
    assert len(read_sweep({"vary": {"phase": [10, 10.0, 20]}}, "x")[1]) == 2, "equal trials are one"


def test_random_sweep_is_repeatable() -> None:
    data: dict[str, Any] = {
        "method": "random", "trials": 40, "seed": 3,
        "vary": {"phase": {"from": 30, "to": 60}, "bars": {"from": 1, "to": 3}, "rule": ["hebbian", "competitive"],
                 "gamma": {"from": 0.1, "to": 10, "scale": "log"}},
    }  # fmt: skip
    found = read_sweep(data, "x")[1]
    assert found == read_sweep(data, "x")[1] != read_sweep(data | {"seed": 4}, "x")[1]
    assert {t.bars for t in found} == {1, 2, 3}
    assert all(30 <= t.phase <= 60 and 0.1 <= t.gamma <= 10 for t in found)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"vary": {"gama": [1]}}, "unknown name 'gama'; did you mean gamma?"),
        ({"varry": {"gamma": [1]}}, "varry"),
        ({}, "vary"),
        ({"vary": {"gamma": {"from": 1, "to": 2, "steps": 0}}}, "steps"),
        ({"method": "random", "trials": 0, "vary": {"gamma": [1]}}, "trials"),
        ({"vary": {"gamma": [-1]}}, "gamma"),
        ({"vary": {"gamma": ["fast"]}}, "gamma"),
        ({"vary": {"bars": [1.5]}}, "bars"),
        ({"vary": {"rule": ["hebb"]}}, "competitive"),
        ({"vary": {"gamma": {"from": 0, "to": 3, "steps": 2, "scale": "log"}}}, "must be positive"),
        ({"vary": {"gamma": [1]}, "show": ["sucess"]}, "did you mean success?"),
        ({"vary": {n: {"from": 0, "to": 1, "steps": 2000} for n in ("gamma", "phase")}}, "4000000 trials"),
    ],
)
def test_errors_name_the_key(data: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=r"^file\.toml") as error:
        read_sweep(data, "file.toml")
    assert words in str(error.value)


def test_included_sweeps() -> None:
    for name in ("binding", "maps"):
        assert len(read_sweep(toml_values(SWEEPS / f"{name}.toml"), name)[1]) > 100


@pytest.mark.slow
def test_batch_equals_single_trials(bars: Stimuli, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two bars at 290° are separated; bars in phase, and a network that does not learn, are not."""
    monkeypatch.setattr(trials, "film", lambda: bars)
    several = [BindingTrial(), BindingTrial(phase=0.0), BindingTrial(gamma=0.0), BindingTrial(noise=0.05, seed=7)]
    together = run_block(several)
    assert [result["success"] for result in together[:3]] == [1.0, 0.0, 0.0]
    assert together[2]["largest"] == 0.0
    for one in (0, 3):
        alone = run_block([several[one]])[0]
        assert alone["owners"] == together[one]["owners"]
        assert alone["largest"] == pytest.approx(together[one]["largest"], abs=1e-4)


@pytest.mark.slow
def test_sweep_continues(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A larger sweep of the same name runs the new trials alone."""
    file, out = tmp_path / "small.toml", tmp_path / "out"
    file.write_text("[vary]\nphase = [60, 290]\n[fixed]\nseconds = 2.0\n")
    command = ["sweep", str(file), "--out", str(out), "--jobs", "1", "--json"]
    assert main(command) == 0
    file.write_text("[vary]\nphase = [60, 290, 300]\n[fixed]\nseconds = 2.0\n")
    assert main(command) == 0
    first, second = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert (first["trials"], first["computed_now"]) == (2, 2)
    assert (second["trials"], second["computed_now"]) == (3, 1)
    assert sorted(pandas.read_parquet(out / "results.parquet")["phase"]) == [60.0, 290.0, 300.0]
    assert (out / "heatmap-success.png").is_file()
    assert "| phase | 290 | 1 |" in (out / "summary.md").read_text()
