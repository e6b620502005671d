"""The ring stimulus against the printed equation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ndtorch.scenes import rings


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
