"""Trials of binding, in batches that give what single trials give, and of driving."""

from __future__ import annotations

from typing import Any

import pytest

from ndtorch.errors import InputError
from ndtorch_train.superposed import Bars
from ndtorch_train.sweep import binding, driving
from ndtorch_train.sweep.config import parse
from ndtorch_train.sweep.parameters import Trial, trial_id

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
