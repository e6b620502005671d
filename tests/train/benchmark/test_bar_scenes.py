"""Random bar scenes, and how they are scored."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.cli.commands import main
from ndtorch.errors import InputError
from ndtorch_train.benchmark import over_time
from ndtorch_train.benchmark.bar_scenes import (
    ALIKE,
    FPS,
    MOST_SCENES,
    RANDOM,
    SETTLE,
    RenderedBars,
    Restriction,
    SceneSet,
    draw_scene,
    first_stage,
    measure_bar,
    scenes_of,
    seeds,
    single_bars,
    superposed,
    true_features,
)
from ndtorch_train.benchmark.bar_scenes import FIRST_SEED as FIRST_SEED_OF_RANDOM
from ndtorch_train.benchmark.hard_scenes import FADE, FIRST_SEED, HARD, HARD_SECONDS, hard_scenes, hard_trial
from ndtorch_train.benchmark.scene_scores import feature_f1, right_from, score_scene
from ndtorch_train.benchmark.scenes import paper_bars
from ndtorch_train.superposed import rendered_sums


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
@pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.long), 1])
def test_superposed_sums_are_those_of_frames(seed: int) -> None:
    """The first two scenes of the tune split, as they are: one bar and two."""
    scene, seconds = draw_scene(seed), 5.0
    rendered = RenderedBars(scene, seconds)
    full, quick = rendered_sums(rendered)[150:].numpy(), superposed([scene], seconds)[0, 150:].numpy()
    strong = quick.std(0) > 0.1 * np.repeat(
        [quick[:, :4].std(0).max(), quick[:, 4:7].std(0).max(), quick[:, 7:].std(0).max()], [4, 3, 3]
    )
    correlations = [np.corrcoef(full[:, k], quick[:, k])[0, 1] for k in strong.nonzero()[0]]
    assert min(correlations) > 0.99


@pytest.mark.slow
@pytest.mark.parametrize(("direction", "orientation"), [pytest.param(0, 0, marks=pytest.mark.long), (3, 6)])
def test_the_table_of_single_bars_is_measured(direction: int, orientation: int) -> None:
    assert_allclose(single_bars()[direction, orientation], measure_bar(direction, orientation), rtol=2e-3, atol=0.5)


def test_truth_of_a_bar_has_a_feature_in_every_group() -> None:
    for truth in true_features([draw_scene(seed) for seed in range(12)], first_stage()):
        for group in (truth[:, :4], truth[:, 4:7], truth[:, 7:]):
            assert group.any(-1).all()


@pytest.mark.parametrize("chosen", [RANDOM, *ALIKE], ids=lambda chosen: chosen.name)
def test_scenes_are_drawn_as_the_set_says(chosen: SceneSet) -> None:
    scenes = scenes_of(chosen, "tune", 6)
    assert {len(scene.bars) for scene in scenes} == set(chosen.bars)
    for scene in scenes:
        if chosen.restriction.same_color:
            assert len({bar.color for bar in scene.bars}) == 1
        if chosen.restriction.same_direction:
            assert len({(bar.direction, bar.orientation) for bar in scene.bars}) == 1
    assert {scene.seed for scene in scenes}.isdisjoint(s.seed for s in scenes_of(chosen, "test", 6))


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


def test_a_confidence_that_is_the_ratio_of_right_answers_has_no_calibration_error() -> None:
    right = np.array([[True, True], [True, False]])
    honest = over_time.Bins.of(np.full((2, 2), 0.75), right)
    sure = over_time.Bins.of(np.full((2, 2), 0.95), right)
    assert honest is not None
    assert sure is not None
    assert honest.row()["error"] == 0
    assert honest.row()["stable_right"] is None
    assert sure.row()["error"] == pytest.approx(0.2)
    assert sure.row()["stable_right"] == 0.75
    rows = [{"set": name, "method": "m", "scenes": 2, **one.row()} for name, one in (("a", honest), ("b", sure))]
    (every,) = over_time.in_all(rows)
    assert every["error"] == pytest.approx(0.1)
    assert every["stable"] == 0.5


def features(*rows: str) -> torch.Tensor:
    """Bool rows from strings of 0 and 1."""
    return torch.tensor([[c == "1" for c in row] for row in rows], dtype=torch.bool).reshape(len(rows), 10)


def test_the_truth_of_the_papers_bars() -> None:
    two = paper_bars("two bars", 1.0)
    assert two.sums.shape == (18, 100, 10)
    # Red: right, down, 0°, 120°; green: left, down, 0°, 60°. [B fig. 8]
    assert torch.equal(two.truth[0], features("0110101100", "1010110010"))


def test_the_command_writes_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = f"benchmark scenes --methods scale-free greedy --scenes 3 --seconds 2 --jobs 1 --out {out} --json"
    assert main(words.split()) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [(row["method"], row["seconds"]) for row in rows] == [("scale-free", 2), ("greedy", 2)]
    assert "| random | scale-free | yes | 2 |" in (out / "scenes.md").read_text(encoding="utf-8")
    assert len((out / "scenes.csv").read_text(encoding="utf-8").splitlines()) == 3
    assert (out / "scores.png").stat().st_size > 5000
    assert "Split tune" in (out / "report.html").read_text(encoding="utf-8")


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
    assert right_from(times, np.array([2, 2, 2, 2, 1]), 2) == math.inf
