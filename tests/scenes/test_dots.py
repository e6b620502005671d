"""Random dots by common fate."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from ndtorch.scenes import CommonFate


def test_no_single_frame_shows_the_patch() -> None:
    # Dots are as dense and as light inside as outside, over many frames of short-lived dots.
    scene = CommonFate(2.0, lifetime=0.12, density=0.03, seed=1)
    frames, masks = scene.frames(0, 50)[:, 0], scene.masks(0, 50)[:, 0]
    inside, outside = frames[masks], frames[~masks]
    dots = [float(((part - 0.5).abs() > 0.2).float().mean()) for part in (inside, outside)]
    assert dots[0] == pytest.approx(dots[1], rel=0.06)
    assert float(inside.mean()) == pytest.approx(float(outside.mean()), abs=0.01)


@pytest.mark.parametrize("coherence", [1.0, 0.4])
def test_that_share_of_the_dots_moves_with_the_patch(coherence: float) -> None:
    # 25 pixels a second at 25 frames a second: four frames later everything is four pixels on.
    scene = CommonFate(1.0, coherence=coherence, lifetime=np.inf, density=0.04, speed=25.0, seed=3)
    (patch,) = scene.patches
    frames, masks = scene.frames(0, 25)[:, 0] - 0.5, scene.masks(0, 25)[:, 0]
    rows, columns = np.mgrid[0 : scene.size[0], 0 : scene.size[1]]
    same = []
    for first in range(0, 20, 4):
        shift = np.array(patch.velocity) * 4 / 25
        r, c = (rows + shift[1]).round().astype(int), (columns + shift[0]).round().astype(int)
        r, c = r.clip(0, scene.size[0] - 1), c.clip(0, scene.size[1] - 1)
        now, later = frames[first], frames[first + 4].numpy()[r, c]
        both = masks[first] & torch.from_numpy(masks[first + 4].numpy()[r, c])
        same.append(float((now[both] * torch.from_numpy(later)[both]).mean() / now[both].square().mean()))
    assert np.mean(same) == pytest.approx(0.85 * coherence, abs=0.15)


def test_the_same_whatever_the_chunks_and_another_with_another_seed() -> None:
    scene = CommonFate(0.4, patches=2, seed=5)
    whole = scene.frames(0, 10)
    assert torch.equal(torch.cat(list(scene.chunks(3))), whole)
    assert torch.equal(CommonFate(0.4, patches=2, seed=5).frames(4, 5)[0], whole[4])
    assert not torch.equal(CommonFate(0.4, patches=2, seed=6).frames(4, 5)[0], whole[4])
    assert whole.shape == (10, 3, 144, 192)
    assert 0 <= float(whole.min()) < 0.2 < 0.8 < float(whole.max()) <= 1


def test_masks_are_apart_and_centered() -> None:
    scene = CommonFate(1.0, patches=3, seed=2)
    masks = scene.masks(12, 13)[0]
    assert masks.shape == (3, 144, 192)
    assert int(masks.sum(0).max()) == 1
    middle = scene.centers(12, 13)[0]
    for mask, (column, row) in zip(masks, middle.tolist(), strict=True):
        rows, columns = mask.nonzero().double().mean(0).tolist()
        assert (columns, rows) == pytest.approx((column, row), abs=0.6)
