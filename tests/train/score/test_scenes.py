"""Random scenes: a seed is a scene, and superposed sums are those of frames."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.vision import VisualFeatures
from ndtorch_train.score.scenes import RenderedBars, Restriction, draw_scene, seeds, superposed


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
