"""Films of moving bars, their truth, and the table of methods."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.vision import FEATURES
from ndtorch_train.benchmark import over_time
from ndtorch_train.benchmark.bar_scenes import CONDITIONS, FIRST_SEED, Sums, apart, draw_film, kept_sums
from ndtorch_train.benchmark.over_time import bins, color_rank, fast_ica, features_right, over_time_benchmark, summary


@pytest.mark.parametrize("name", CONDITIONS)
def test_films_are_in_range_and_do_not_depend_on_chunks(name: str) -> None:
    film, again = (draw_film(name, "tune", 1) for _ in range(2))
    frames = film.frames(0, 4)
    assert frames.shape == (4, 3, *film.size)
    assert 0 <= float(frames.min()) <= float(frames.max()) <= 1
    assert torch.equal(frames, again.frames(0, 4))
    assert torch.allclose(frames * 255, (frames * 255).round(), atol=1e-4)
    assert len(film.bars) in CONDITIONS[name].bars


def test_no_seed_is_in_both_splits() -> None:
    assert FIRST_SEED["tune"] + 1000 * len(CONDITIONS) <= FIRST_SEED["test"]
    one, other = (draw_film("black, 4 bars", split, 0).frames(0, 1) for split in ("tune", "test"))
    assert not torch.equal(one, other)


def test_grounds_and_noise_are_as_bright_as_they_say() -> None:
    ground = draw_film("grey ground .4", "tune", 0).frames(0, 1)
    assert float(ground.median()) == pytest.approx(0.4, abs=1 / 255)
    noisy = draw_film("grey ground .4, noise 1 %", "tune", 0).frames(0, 1)
    assert float(noisy[..., 0, :].std()) == pytest.approx(0.01, abs=0.002)


def test_hues_keep_their_distance() -> None:
    hues = apart(np.random.default_rng(3), 4, 360, 60)
    gaps = [abs((a - b + 180) % 360 - 180) for n, a in enumerate(hues) for b in hues[:n]]
    assert min(gaps) >= 60


def test_sums_are_kept_with_the_features_of_each_bar(tmp_path: Path) -> None:
    film = draw_film("two_bars, any phase", "tune", 1)
    film.length = 10
    first = kept_sums(film, tmp_path / "film.npz")
    again = kept_sums(film, tmp_path / "film.npz")
    assert torch.equal(first.sums, again.sums)
    assert first.sums.shape == (10, 10)
    names = [{FEATURES[k] for k in row.nonzero().flatten().tolist()} for row in first.truth]
    # The table of the papers: red moves right, green left. [B fig. 8]
    assert {"red", "right"} <= names[0]
    assert {"green", "left"} <= names[1]


def mixture(noise: float = 0.0) -> Sums:
    """Two sources of pure color, a sine and a slower one, 25 samples a second."""
    time = torch.arange(0, 45, 1 / 25)
    light = torch.stack([torch.sin(2 * math.pi * time), torch.sin(3.7 * time + 1)], -1) + 2
    gains = torch.zeros(2, 10)
    gains[0, [1, 4, 7]] = 1.0
    gains[1, [0, 5, 8]] = 1.0
    sums = light @ gains + noise * torch.randn(len(time), 10)
    return Sums(sums, gains > 0, [(0.0, 45.0)] * 2, 25.0)


def test_peers_count_what_is_plain() -> None:
    film = draw_film("two_bars, any phase", "tune", 0)
    for method in (color_rank, fast_ica):
        assert [reading.number for reading in method(film, mixture(), [20, 30])] == [2, 2]
    (reading,) = fast_ica(film, mixture(0.001), [30])
    assert reading.features is not None
    assert features_right(reading.features, mixture().truth)


def test_features_are_right_with_an_object_for_each_bar() -> None:
    truth = mixture().truth
    assert features_right(truth.flip(0), truth)
    assert not features_right(truth[:1], truth)
    assert not features_right(truth[[0, 0]], truth)


def test_reliability_is_that_of_the_bins() -> None:
    confidence, right = np.array([0.95] * 10 + [0.55] * 10), np.array([True] * 9 + [False] + [True] * 5 + [False] * 5)
    row = summary(np.array(bins(confidence, right)))
    assert (row["stable"], row["stable_right"]) == (0.5, 0.9)
    assert row["error"] == pytest.approx((0.5 + 0.5) / 20)


def test_the_table_has_a_row_for_each_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(over_time, "kept_sums", lambda film, path: mixture())
    made = over_time_benchmark(["scale-free", "published", "color rank"], ["two_bars, any phase"], 1, "tune")
    rows, text, folder, failed = made.run(tmp_path / "out", 1, False, print)
    assert not failed
    assert [row["method"] for row in rows] == ["scale-free", "published", "color rank"]
    assert rows[2]["count"] == 1.0
    assert "| all | scale-free |" in text
    assert (folder / "reliability.png").is_file()
    with pytest.raises(InputError, match="did you mean scale-free"):
        over_time_benchmark(["scalefree"], [], 1, "tune")
