"""Overlapping receptive fields."""

from __future__ import annotations

import math

import pytest
import torch

from ndtorch.vision import field_weights
from ndtorch.vision.receptive_fields import Edge, Shape, means


def tents(length: int, fields: int) -> torch.Tensor:
    return means(field_weights(torch.arange(length) + 0.5, length, fields, "open", "tent"))


@pytest.mark.parametrize("shape", ["cosine", "tent"])
@pytest.mark.parametrize("border", ["wrap", "reflect"])
@pytest.mark.parametrize(("length", "fields"), [(500, 16), (120, 7), (33, 5), (40, 1)])
def test_windows_add_up_to_one_everywhere(shape: Shape, border: Edge, length: int, fields: int) -> None:
    weights = field_weights(torch.arange(length, dtype=torch.float64) + 0.5, length, fields, border, shape)
    assert weights.shape == (fields, length)
    assert float((weights.sum(0) - 1).abs().max()) < 1e-12
    assert float(weights.min()) >= 0


def test_a_window_is_a_raised_cosine() -> None:
    weights = field_weights(torch.tensor([15.0, 20.0, 22.5, 25.0, 35.0]), 100, 10)
    half = 0.5 + 0.5 * math.cos(math.pi * 0.75)
    assert weights[1].tolist() == pytest.approx([1.0, 0.5, half, 0.0, 0.0], abs=1e-6)


def test_a_window_is_a_tent() -> None:
    weights = field_weights(torch.tensor([1.0, 5.0, 20.0, 22.5, 25.0]), 100, 10, "open", "tent")
    assert weights[0].tolist() == pytest.approx([0.6, 1.0, 0.0, 0.0, 0.0], abs=1e-6)
    assert weights[1].tolist() == pytest.approx([0.0, 0.0, 0.5, 0.25, 0.0], abs=1e-6)


def test_fields_are_means_and_overlap_by_half() -> None:
    weights = tents(12, 3)
    assert torch.allclose(weights.sum(1), torch.ones(3))
    # Where the first falls off, the second rises: both see the pixels between their centers.
    assert ((weights[0] > 0) & (weights[1] > 0)).sum() == 4
    assert weights[1].argmax() in (5, 6)
    assert torch.equal(tents(5, 1), torch.full((1, 5), 0.2))
