"""Random scenes: a seed is a scene, superposed sums are those of frames, and every bar has true features."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ndtorch_train.benchmark.bar_scenes import (
    ALIKE,
    RANDOM,
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
@pytest.mark.parametrize("seed", [0, 1])
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
@pytest.mark.parametrize(("direction", "orientation"), [(0, 0), (3, 6)])
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
