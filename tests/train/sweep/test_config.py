"""What a sweep's file may say, and what is said about files that may not."""

from __future__ import annotations

from pathlib import Path

import pytest

from ndtorch.errors import InputError
from ndtorch.utils.packages import folder_of
from ndtorch_train.sweep.config import parse, read_sweep
from ndtorch_train.sweep.parameters import trial_id

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
