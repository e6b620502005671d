"""Rendered scenes for fields."""

from __future__ import annotations

import pytest
import torch

from ndtorch_train.score import retinotopic_rendered as local
from ndtorch_train.score.scenes import Restriction, Scene, draw_scene

TEXTURED, STEADY, FAST, LARGE, HIDDEN, STOPPING = local.SETS


def test_a_ground_shows_where_no_bar_is_and_stays() -> None:
    scene = draw_scene(local.FIRST_SEED, Restriction(1))
    first, last = local.OnGround(scene, TEXTURED).frames(0, 40)[[0, -1]]
    same = (first == last).all(0)
    assert 0.98 < same.double().mean() < 1
    assert torch.equal(first[:, same], local.ground(scene.seed)[:, same])


def test_steady_bars_do_not_fluctuate_and_large_ones_are_larger() -> None:
    scene = draw_scene(local.FIRST_SEED, Restriction(1))
    moments = range(0, 240, 40)

    def brightest(kind: local.LocalScenes) -> torch.Tensor:
        shown = local.OnGround(scene, kind)
        return torch.stack([shown.frames(n, n + 1).amax() for n in moments])

    plain, steady, large = (brightest(kind) for kind in (FAST, STEADY, LARGE))
    torch.testing.assert_close(steady, torch.full_like(steady, 0.6 * max(scene.bars[0].color)))
    assert plain.std() > 0.01
    torch.testing.assert_close(large, plain)
    areas = [local.OnGround(scene, kind).frames(0, 1).sum() for kind in (FAST, LARGE)]
    assert float(areas[1] / areas[0]) == pytest.approx(90 * 25 / (50 * 12), rel=0.05)


def test_a_bar_stands_for_half_a_second_and_goes_on_from_there() -> None:
    scene = draw_scene(local.FIRST_SEED, Restriction(1))
    assert local.moved(torch.tensor([0, 74, 75, 99, 100, 101, 200]), 0.5).tolist() == [0, 74, 75, 75, 75, 76, 150]
    covers = [local.OnGround(scene, STOPPING).frames(n, n + 1)[0].amax(0) > 0 for n in (60, 80, 95)]
    assert torch.equal(covers[1], covers[2])
    assert not torch.equal(covers[0], covers[1])


def test_a_cross_hides_what_is_behind_it() -> None:
    shown = local.OnGround(draw_scene(local.FIRST_SEED, Restriction(3)), HIDDEN).frames(0, 2)
    middle = slice(220, 280)
    assert shown[..., middle, :].unique().numel() == shown[..., :, middle].unique().numel() == 1
    assert shown[..., :220, :220].unique().numel() > 1 or shown[..., 280:, 280:].unique().numel() > 1


@pytest.mark.slow
def test_a_ground_without_bars_is_nothing() -> None:
    empty = local.OnGround(Scene(3, ()), TEXTURED, seconds=0.6)
    assert local.seen_in(empty).shape == (0, 10)
