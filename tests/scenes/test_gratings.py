"""Gratings, rings and dots."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from ndtorch.scenes import rings
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
