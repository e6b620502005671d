"""Verdicts."""

from __future__ import annotations

from ndtorch_train.reproduce.claims import chosen
from ndtorch_train.reproduce.outcome import verdict_of, with_better


def test_verdicts() -> None:
    assert verdict_of(True, True) == "holds"
    assert verdict_of(True, False) == "partly"
    assert verdict_of(False, False) == "does not hold"


def test_better_parts_stand_behind_what_they_better() -> None:
    assert [claim.id for claim in with_better(chosen(["B5", "B7", "C9"]))] == ["B5", "B7", "B7+", "C9", "C9+"]
