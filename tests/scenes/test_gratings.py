"""Gratings, rings and dots."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from ndtorch.scenes import CommonFate, rings
from ndtorch.scenes.gratings import FlickeringGrating, MovingGrating, bar_coverage


def whole(source, frames=64):
    return torch.cat(list(source.chunks(frames)), -4)


def test_shape_levels_and_contrast():
    rows = whole(MovingGrating([0.5, 1.0, -1.7], [0.0, 0.4], length=30))
    assert rows.shape == (3, 2, 30, 1, 1, 640)
    assert (float(rows.min()), float(rows.max())) == (0.25, 0.75)
    assert (rows.max() - rows.min()) / (rows.max() + rows.min()) == 0.5
    # 32 whole periods fit into a row: half of it is bright at every place and speed.
    torch.testing.assert_close(rows.mean(-1), torch.full((3, 2, 30, 1, 1), 0.5))


@pytest.mark.parametrize("position", [0.0, 0.3, -7.75, 1234.5])
def test_coverage_against_fine_sampling(position):
    fine = 1000
    x = (torch.arange(40 * fine, dtype=torch.float64) + 0.5) / fine
    bright = ((x - position) % 20 < 10).double().reshape(40, fine).mean(-1)
    found = bar_coverage(torch.tensor(position, dtype=torch.float64), 10.0, 20.0, 40)
    torch.testing.assert_close(found, bright, atol=2 / fine, rtol=0)


def test_motion_is_to_the_right_and_exact():
    rows = whole(MovingGrating([1.0], [0.25], length=12))[0, 0, :, 0, 0]
    torch.testing.assert_close(rows[5, 5:], rows[0, :-5])
    slow = whole(MovingGrating([0.25], [0.0], length=5))[0, 0, :, 0, 0]
    assert slow[1, 0] == pytest.approx(0.25 + 0.5 * 0.75)
    torch.testing.assert_close(slow[4, 1:], slow[0, :-1])


def test_flicker_follows_the_sinusoid():
    rows = whole(FlickeringGrating(14.9, length=40))
    still = whole(MovingGrating([0.0], length=1))[0, 0, 0]
    for t in range(40):
        factor = 0.5 + 0.5 * math.sin(2 * math.pi * 14.9 * t / 30)
        torch.testing.assert_close(rows[t], factor * still)
    uniform = whole(FlickeringGrating(length=9, uniform=True))
    assert uniform.std(-1).max() == 0
    assert uniform.std() > 0


@pytest.mark.parametrize("number", [0, 37, 130, 399])
def test_values_of_the_printed_equation(number: int) -> None:
    frame = rings(4.0).frames(number, number + 1)[0].numpy()
    t = number / 100
    for row, column in ((0, 0), (49, 50), (50, 61), (12, 83)):
        r = math.hypot(row - 49.5, column - 49.5)
        theta, psi = 2 * math.pi * 0.5 * t, 2 * math.pi * 0.2 * r + 2 * math.pi * 0.5 * t
        want = math.exp(-(r**2) / 1250) * (1 + math.sin(theta)) / 2 * (1 + math.cos(psi)) / 2
        np.testing.assert_allclose(frame[:, row, column], want, atol=1e-6)


def test_rings_contract() -> None:
    # A crest r = n / 0.2 - t * 0.5 / 0.2 moves inwards at 2.5 px/s.
    row = rings(2.0, size=(1, 201), sigma=1e6, flicker=0.0).frames(0, 81)[:, 0, 0, 100:]
    crest = row[:, 3:8].argmax(-1) + 3
    assert crest[0] == 5
    assert crest[80] == 3


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
