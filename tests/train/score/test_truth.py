"""The true features of a scene."""

from __future__ import annotations

from ndtorch_train.score.methods import first_stage
from ndtorch_train.score.scenes import draw_scene
from ndtorch_train.score.truth import true_features


def test_truth_of_a_bar_has_a_feature_in_every_group() -> None:
    for truth in true_features([draw_scene(seed) for seed in range(12)], first_stage()):
        for group in (truth[:, :4], truth[:, 4:7], truth[:, 7:]):
            assert group.any(-1).all()
