"""Overlapping receptive fields."""

from __future__ import annotations

import math

import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.vision import field_weights
from ndtorch.vision.receptive_fields import Edge, Shape, means, pool


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


def test_pool_is_the_weighted_mean() -> None:
    image = torch.arange(24.0).reshape(4, 6)
    assert pool(image, tents(4, 1), tents(6, 1)).item() == pytest.approx(11.5)
    assert pool(torch.ones(2, 12, 20), tents(12, 3), tents(20, 4)) == pytest.approx(torch.ones(2, 3, 4))


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="fields must be between 1 and the 3 pixels of a side, got 4"):
        tents(3, 4)
    points = torch.arange(9) + 0.5
    with pytest.raises(InputError, match="shape must be one of cosine, tent, got 'box'"):
        field_weights(points, 9, 3, shape="box")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="border must be one of wrap, reflect, open, got 'zero'"):
        field_weights(points, 9, 3, "zero")  # type: ignore[arg-type]
