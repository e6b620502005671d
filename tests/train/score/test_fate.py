"""Scores of patches of moving dots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ndtorch.errors import InputError
from ndtorch.scenes import CommonFate
from ndtorch_train.score.fate.command import FateComparison
from ndtorch_train.score.fate.methods import METHODS, Found
from ndtorch_train.score.fate.scoring import FIRST_SEED, conditions, scored, wanted_conditions, wanted_methods


def masks() -> np.ndarray:
    truth = np.zeros((2, 40, 60), dtype=bool)
    truth[0, 5:15, 5:15] = truth[1, 20:30, 40:50] = True
    return truth


def test_scores_tell_right_from_wrong() -> None:
    truth = masks()
    right = [Found((10.0, 10.0), truth[0]), Found((45.0, 25.0), truth[1])]
    assert scored(right, truth) == (True, 1.0, 1.0)
    # Half of one, nothing of the other, and one where nothing is.
    half = truth[0].copy()
    half[:, 10:] = False
    count, place, overlap = scored([Found((7.0, 10.0), half), Found((30.0, 3.0), None)], truth)
    assert (count, place, overlap) == (True, 0.5, 0.25)
    assert scored([], truth) == (False, 0.0, 0.0)
    assert scored([Found((1.0, 1.0), None)], truth[:0]) == (False, 0.0, None)


def test_splits_have_no_seed_in_common() -> None:
    assert FIRST_SEED["tune"] + 10_000 * len(conditions()) < FIRST_SEED["test"]


@pytest.mark.parametrize("method", METHODS)
def test_every_method_says_what_is_there_at_every_moment(method: str) -> None:
    scene = CommonFate(0.6, seed=3, size=(64, 80))
    found = METHODS[method]()(scene, [4, 14])
    assert len(found) == 2
    for thing in (thing for now in found for thing in now):
        assert len(thing.place) == 2
        assert thing.mask is None or thing.mask.shape == scene.size


def test_unknown_methods_are_refused() -> None:
    with pytest.raises(InputError, match="must be among"):
        wanted_methods(["moog"])


def test_conditions_are_chosen_by_name() -> None:
    assert [one.value for one in wanted_conditions(["ground"])] == [0.5, 1.0]
    assert wanted_conditions([]) == conditions()
    with pytest.raises(InputError, match="did you mean density"):
        wanted_conditions(["densty"])


def test_the_table_has_a_row_for_every_condition_and_method(tmp_path: Path) -> None:
    asked = wanted_conditions(["coherence"])[:1]
    rows, text = FateComparison(["mog2"], "tune", 1, lambda words: None, asked)(tmp_path)
    assert [(row["condition"], row["value"], row["method"]) for row in rows] == [("coherence", 1, "mog2")]
    assert "| coherence 1 |" in text
    assert (tmp_path / "common-fate.png").stat().st_size > 10_000
