"""Verdicts."""

from __future__ import annotations

from ndtorch_train.reproduce.outcome import verdict_of


def test_verdicts() -> None:
    assert verdict_of(True, True) == "holds"
    assert verdict_of(True, False) == "partly"
    assert verdict_of(False, False) == "does not hold"
