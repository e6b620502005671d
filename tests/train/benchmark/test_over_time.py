"""Scenes that are watched over time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch_train.benchmark import over_time


@pytest.mark.parametrize("name", over_time.SETS)
def test_every_scene_has_its_bars_and_the_splits_have_none_in_common(name: str) -> None:
    tune, test = (over_time.scenes_of(name, split, 2)[1]() for split in ("tune", "test"))
    assert tune.truth.shape[1] == 10
    assert tune.truth.any(1).all()
    assert not torch.equal(tune.source.frames(100, 101), test.source.frames(100, 101))


def test_bars_of_crossings_cover_each_other() -> None:
    for draw in over_time.scenes_of("crossings", "tune", 3):
        source = draw().source
        assert isinstance(source, over_time.RenderedBars)
        first, *others = source.scene.bars
        seconds = np.arange(over_time.COVERED_FROM, over_time.COVERED_TO, 0.05)
        for other in others:
            away = np.stack([over_time.place(first, s) - over_time.place(other, s) for s in seconds])
            away = (away + 250) % 500 - 250
            assert np.hypot(*away.T).min() < over_time.WIDTH


def test_sums_are_kept(tmp_path: Path) -> None:
    (draw, *_) = over_time.scenes_of("random", "tune", 1)
    first = over_time.kept_sums(draw, 0.1, tmp_path / "sums.npy")
    assert first.shape == (10, 10)
    assert torch.equal(first, over_time.kept_sums(lambda: pytest.fail("rendered again"), 0.1, tmp_path / "sums.npy"))


def test_times_that_no_scene_has_are_refused() -> None:
    with pytest.raises(InputError, match="seconds"):
        over_time.over_time_benchmark(["scale-free"], ["random"], 1, 500.0, "tune")
