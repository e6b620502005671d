"""The list of claims."""

from __future__ import annotations

import pytest

from ndtorch.errors import InputError
from ndtorch.utils.packages import files_of
from ndtorch_train.reproduce.claims import CLAIMS, chosen
from ndtorch_train.reproduce.experiment import verdict_of, with_better


def test_every_claim_of_the_list_is_there() -> None:
    ids = [claim.id for claim in CLAIMS]
    assert ids == [f"A{k}" for k in range(1, 10)] + [f"B{k}" for k in range(1, 11)] + [f"C{k}" for k in range(1, 10)]
    for claim in CLAIMS:
        assert all(files_of(use) for use in claim.uses), claim.id
        assert claim.printed
        assert claim.tolerance


def test_the_same_claim_is_tried_with_better_parts() -> None:
    """What does not hold as published has a second try within the same tolerance."""
    tried = {claim.id: claim.better for claim in CLAIMS if claim.better is not None}
    assert set(tried) == {"A4", "A8", "B7", "B9", "B10", "C8", "C9"}
    for claim in CLAIMS:
        if claim.better is not None:
            again = claim.better
            assert (again.id, again.tolerance, again.text) == (f"{claim.id}+", claim.tolerance, claim.text)
            assert again.parts
            assert again.better is None
            assert all(files_of(use) for use in again.uses), again.id


def test_claims_by_name() -> None:
    assert [claim.id for claim in chosen(["c5", "A1"])] == ["A1", "C5"]
    assert len(chosen([])) == len(CLAIMS)
    with pytest.raises(InputError, match=r"unknown claim 'B55'; claims are A1, .*; did you mean B5"):
        chosen(["B55"])


def test_verdicts() -> None:
    assert verdict_of(True, True) == "holds"
    assert verdict_of(True, False) == "partly"
    assert verdict_of(False, False) == "does not hold"


def test_better_parts_stand_behind_what_they_better() -> None:
    assert [claim.id for claim in with_better(chosen(["B5", "B7", "C9"]))] == ["B5", "B7", "B7+", "C9", "C9+"]
