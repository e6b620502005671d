"""Overlapping receptive fields."""

from __future__ import annotations

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.vision.fields import pool, tents


def test_fields_are_means_and_overlap_by_half() -> None:
    weights = tents(12, 3)
    assert torch.allclose(weights.sum(1), torch.ones(3))
    # Where the first falls off, the second rises: both see the pixels between their centres.
    assert ((weights[0] > 0) & (weights[1] > 0)).sum() == 4
    assert weights[1].argmax() in (5, 6)
    assert torch.equal(tents(5, 1), torch.full((1, 5), 0.2))


def test_pool_is_the_weighted_mean() -> None:
    image = torch.arange(24.0).reshape(4, 6)
    assert pool(image, tents(4, 1), tents(6, 1)).item() == pytest.approx(11.5)
    assert pool(torch.ones(2, 12, 20), tents(12, 3), tents(20, 4)) == pytest.approx(torch.ones(2, 3, 4))


def test_more_fields_than_pixels_are_refused() -> None:
    with pytest.raises(InputError, match="fields"):
        tents(3, 4)
