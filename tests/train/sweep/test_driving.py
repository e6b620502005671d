"""Trials of driving."""

from __future__ import annotations

from typing import Any

import pytest

from ndtorch.errors import InputError
from ndtorch_train.sweep import driving
from ndtorch_train.sweep.config import parse


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
