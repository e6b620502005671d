"""Sets that are harder than the papers' scenes."""

from __future__ import annotations

import pytest

from ndtorch_train.score.methods import first_stage
from ndtorch_train.score.scenes import FPS
from ndtorch_train.score.stress import STRESS, stressed


@pytest.mark.parametrize("name", ["static", "80 ms", "four bars"])
def test_stress_sets_are_what_they_say(name: str) -> None:
    stress = next(s for s in STRESS if s.name == name)
    trial = stressed(stress, "tune", 2, first_stage())
    steps = -(-round(34 * FPS) // stress.every)
    assert trial.sums.shape == (2, steps, 10)
    assert [len(t) for t in trial.truth] == {"static": [0, 0], "80 ms": [1, 2], "four bars": [4, 4]}[name]
    assert (trial.sums.std(1).max() < 1e-3) == (name == "static")
