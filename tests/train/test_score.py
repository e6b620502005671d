"""The benchmark: scenes, truth, metrics, and that superposed sums are those of frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.commands import main
from ndtorch.vision import VisualFeatures
from ndtorch_train.score.bars import bar_sets
from ndtorch_train.score.methods import first_stage
from ndtorch_train.score.metrics import feature_f1, right_from, score_scene
from ndtorch_train.score.scenes import FPS, RenderedBars, Restriction, draw_scene, seeds, superposed
from ndtorch_train.score.single_bars import measure, single_bars
from ndtorch_train.score.stress import STRESS, stressed
from ndtorch_train.score.truth import true_features


def features(*rows: str) -> torch.Tensor:
    """Bool rows from strings of 0 and 1."""
    return torch.tensor([[c == "1" for c in row] for row in rows], dtype=torch.bool).reshape(len(rows), 10)


def test_splits_share_no_seed() -> None:
    assert not set(seeds("tune", 1_000_000)) & set(seeds("test", 1_000_000))


def test_a_scene_is_its_seed() -> None:
    one, other = draw_scene(17), draw_scene(17)
    assert one.bars[0].color == other.bars[0].color
    assert np.array_equal(one.bars[-1].light, other.bars[-1].light)
    assert [len(draw_scene(seed).bars) for seed in range(6)] == [1, 2, 3, 1, 2, 3]
    assert_allclose(superposed([one], 3.0), superposed([one], 8.0)[:, :300], rtol=1e-5)


def test_bars_alike_are_alike() -> None:
    bars = draw_scene(5, Restriction(3, same_direction=True)).bars
    assert len({(bar.direction, bar.orientation) for bar in bars}) == 1
    assert len({bar.color for bar in bars}) == 3
    assert len({bar.color for bar in draw_scene(5, Restriction(3, same_color=True)).bars}) == 1


@pytest.mark.slow
@pytest.mark.parametrize(("direction", "orientation"), [(0, 0), (3, 6)])
def test_the_table_of_single_bars_is_measured(direction: int, orientation: int) -> None:
    assert_allclose(single_bars()[direction, orientation], measure(direction, orientation), rtol=2e-3, atol=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_superposed_sums_are_those_of_frames(seed: int) -> None:
    """The first two scenes of the tune split, as they are: one bar and two."""
    scene, seconds = draw_scene(seed), 5.0
    rendered = RenderedBars(scene, seconds)
    front, state, parts = VisualFeatures(rendered.size), None, []
    with torch.inference_mode():
        for frames in rendered.chunks(8):
            sums, state = front(frames, state)
            parts.append(sums)
    full, quick = torch.cat(parts)[150:].numpy(), superposed([scene], seconds)[0, 150:].numpy()
    strong = quick.std(0) > 0.1 * np.repeat(
        [quick[:, :4].std(0).max(), quick[:, 4:7].std(0).max(), quick[:, 7:].std(0).max()], [4, 3, 3]
    )
    correlations = [np.corrcoef(full[:, k], quick[:, k])[0, 1] for k in strong.nonzero()[0]]
    assert min(correlations) > 0.99


def test_f1_gives_objects_to_bars_as_fits_best() -> None:
    truth = features("1100000100", "0011000010")
    assert feature_f1(truth[[1, 0]], truth).tolist() == [1.0, 1.0]
    # One object for two bars: the other bar has 0. Two of three features right, one wrong: F1 = 2/3.
    assert feature_f1(features("1000100100"), truth).tolist() == pytest.approx([2 / 3, 0.0])
    assert feature_f1(truth[:0], truth).tolist() == [0.0, 0.0]


def test_a_scene_is_ok_when_counted_and_described() -> None:
    truth = features("1100000100", "0011000010")
    assert score_scene(truth, truth).ok
    surplus = score_scene(torch.cat([truth, truth[:1]]), truth)
    assert (surplus.counted, surplus.ok, surplus.f1) == (False, False, 1.0)
    nothing = truth[:0]
    assert score_scene(nothing, nothing).ok
    assert not score_scene(truth, nothing).counted


def test_right_from_is_the_start_of_the_lasting_right_count() -> None:
    times = np.arange(1.0, 6.0)
    assert right_from(times, np.array([1, 2, 1, 2, 2]), 2) == 4.0
    assert right_from(times, np.array([2, 2, 2, 2, 2]), 2) == 1.0
    assert np.isnan(right_from(times, np.array([2, 2, 2, 2, 1]), 2))


def test_the_truth_of_the_papers_bars() -> None:
    two = bar_sets(1.0, first_stage())[0]
    assert two.sums.shape == (18, 100, 10)
    # Red: right, down, 0°, 120°; green: left, down, 0°, 60°. [B fig. 8]
    assert torch.equal(two.truth, features("0110101100", "1010110010"))


@pytest.mark.parametrize("name", ["static", "80 ms", "four bars"])
def test_stress_sets_are_what_they_say(name: str) -> None:
    stress = next(s for s in STRESS if s.name == name)
    trial = stressed(stress, "tune", 2, first_stage())
    steps = -(-round(34 * FPS) // stress.every)
    assert trial.sums.shape == (2, steps, 10)
    assert [len(t) for t in trial.truth] == {"static": [0, 0], "80 ms": [1, 2], "four bars": [4, 4]}[name]
    assert (trial.sums.std(1).max() < 1e-3) == (name == "static")


def test_truth_of_a_bar_has_a_feature_in_every_group() -> None:
    for truth in true_features([draw_scene(seed) for seed in range(12)], first_stage()):
        for group in (truth[:, :4], truth[:, 4:7], truth[:, 7:]):
            assert group.any(-1).all()


def test_the_command_writes_a_leaderboard(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["score", "--rules", "scale-free", "greedy", "--scenes", "3", "--seconds", "2", "--out", str(tmp_path)]
    assert main(arguments) == 0
    assert "| scale-free | yes | 2 |" in (tmp_path / "leaderboard.md").read_text(encoding="utf-8")
    assert len((tmp_path / "leaderboard.csv").read_text(encoding="utf-8").splitlines()) == 3
    assert (tmp_path / "leaderboard.png").stat().st_size > 5000
    assert "Split tune" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--rules", "oja"], ["rules", "published"]),
        (["--seconds", "1000"], ["seconds", "100"]),
        (["--stress", "-1"], ["stress", "-1"]),
        (["--scenes", "2000000"], ["scenes", "1000000"]),
    ],
)
def test_bad_options_are_one_line(options: list[str], words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["score", *options]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert all(word in error for word in words)
