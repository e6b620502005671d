"""Hard sets are what they say."""

from __future__ import annotations

import pytest

from ndtorch_train.benchmark.bar_scenes import FIRST_SEED as FIRST_SEED_OF_RANDOM
from ndtorch_train.benchmark.bar_scenes import FPS, MOST_SCENES, SETTLE
from ndtorch_train.benchmark.hard_scenes import FADE, FIRST_SEED, HARD, HARD_SECONDS, hard_scenes, hard_trial

SETS = {hard.name: hard for hard in HARD}


def test_the_seeds_of_the_sets_and_splits_have_none_in_common() -> None:
    ranges = [range(start, start + MOST_SCENES) for start in (*FIRST_SEED.values(), *FIRST_SEED_OF_RANDOM.values())]
    assert sum(map(len, ranges)) == len(set().union(*({r.start, r[-1]} for r in ranges))) * MOST_SCENES // 2
    drawn = [one.scene.seed for hard in HARD for one in hard_scenes(hard, "tune", 2)]
    assert len(set(drawn)) == 2 * len(HARD)


@pytest.mark.parametrize("name", ["6 objects", "none, smooth", "12.5/s, 10 % lost", "one leaves"])
def test_sets_are_what_they_say(name: str) -> None:
    hard = SETS[name]
    trial = hard_trial(hard, "tune", 2)
    assert trial.sums.shape == (2, -(-round((SETTLE + hard.seconds) * FPS) // hard.every), 10)
    expected = {"6 objects": [6, 6], "none, smooth": [0, 0], "12.5/s, 10 % lost": [1, 2], "one leaves": [1, 2]}
    assert [len(truth) for truth in trial.truth] == expected[name]
    repeated = (trial.sums.diff(dim=1) == 0).all(-1).float().mean()
    assert (repeated > 0.05) == bool(hard.lost)


def test_a_bar_that_leaves_is_dark_afterwards() -> None:
    [one] = hard_scenes(SETS["one leaves"], "tune", 1)
    moment = round((SETTLE + HARD_SECONDS + FADE) * FPS)
    gone = [bar for bar in one.scene.bars if not bar.light[moment:].any()]
    assert len(gone) == 1
    assert len(one.scene.bars) == len(one.shown.bars) + 1
