"""The alpha-beta filter: prediction, correction, and what it converges to."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.vision.temporal import corrected, predicted


def test_one_step_by_hand() -> None:
    place, velocity = torch.tensor([1.0, 2.0]), torch.tensor([3.0, -1.0])
    there = predicted(place, velocity, 0.5)
    assert there.tolist() == [2.5, 1.5]
    place, velocity = corrected(there, velocity, torch.tensor([0.4, 0.0]), 0.5, 0.1, 0.5)
    assert_allclose(place, [2.7, 1.5])
    assert_allclose(velocity, [3.08, -1.0], rtol=1e-6)


@pytest.mark.parametrize("kind", [torch.tensor, np.array])
def test_it_finds_a_steady_motion(kind: type) -> None:
    place, velocity = kind([0.0, 0.0]), kind([0.0, 0.0])
    for n in range(400):
        there = predicted(place, velocity, 0.1)
        seen = kind([5.0 + 0.3 * n * 0.1, -0.2 * n * 0.1])
        place, velocity = corrected(there, velocity, seen - there, 0.3, 0.03, 0.1)
    assert_allclose(velocity, [0.3, -0.2], atol=1e-4)
