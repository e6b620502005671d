"""The table of objects of [C §4.1] and its words."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding import Attention, BoundObject, ObjectTable, bound_objects, describe, object_table
from ndtorch.binding.attention import attention_mask, feature_weights
from ndtorch.binding.objects import simplified
from ndtorch.vision import GROUPS
from tests.strategies import noise


def two_objects() -> torch.Tensor:
    """Columns like those of [C fig. 3c]: red going right and down, green going left and down."""
    weights = torch.zeros(10, 10)
    weights[[1, 2, 4, 6], 7] = torch.tensor([0.8, 0.5, 0.4, 0.4])
    weights[[0, 2, 4, 5], 8] = torch.tensor([0.7, 0.3, 0.45, 0.35])
    weights[3, 0] = 0.4
    weights[8, 7] = 0.1
    return weights


def test_table_of_two_objects() -> None:
    table = object_table(two_objects())
    assert table.owners.nonzero().flatten().tolist() == [7, 8]
    assert_allclose(table.rows[7], [0, 1, 0.625, 0, 0.5, 0, 0.5, 1, 0, 0])
    assert_allclose(table.rows[8], [0.875, 0, 0.375, 0, 0.5625, 0.4375, 0, 0, 1, 0])
    assert not table.rows[[0, 1, 2, 3, 4, 5, 6, 9]].any()
    assert simplified(two_objects())[8, 7] == 0
    assert simplified(two_objects())[3, 0] == 0.5


def test_table_by_a_loop_over_entries() -> None:
    weights = torch.rand(6, 6, generator=torch.Generator().manual_seed(1)).fill_diagonal_(0)
    table = object_table(weights)
    for k in range(6):
        kept = [w if w >= 1 / 3 else 0.0 for w in (weights[:, k] / weights.max()).tolist()]
        assert_allclose(simplified(weights)[:, k], kept)
        assert bool(table.owners[k]) == (sum(kept) > 0.6)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), scale=st.floats(1e-20, 1e11), neurons=st.integers(2, 10))
def test_scaling_changes_nothing(seed: int, scale: float, neurons: int) -> None:
    weights = torch.rand(neurons, neurons, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    weights = weights.fill_diagonal_(0) ** 2
    normed = weights / weights.max()
    assume((normed - 1 / 3).abs().min() > 1e-9)
    before, after = object_table(weights), object_table(weights * scale)
    assert torch.equal(after.owners, before.owners)
    assert_allclose(after.rows, before.rows, rtol=1e-12)


def test_objects_name_their_features() -> None:
    red, green = bound_objects(object_table(two_objects()))
    assert (red.neuron, red.index) == ("red", 7)
    assert red.features == pytest.approx({"right": 1, "down": 0.625, "0°": 0.5, "120°": 0.5, "red": 1})
    assert list(green.features) == ["left", "down", "0°", "60°", "green"]


@pytest.mark.parametrize(
    ("features", "words"),
    [
        ({"left": 1.0}, "no color of its own, moving left, no orientation"),
        ({"blue": 1.0, "60°": 0.4}, "blue, no direction of motion, orientation 60°"),
        (
            {"red": 0.5, "blue": 1.0, "0°": 1.0, "60°": 1.0, "120°": 1.0, "down": 0.4, "left": 0.5},
            "blue and red, moving left and down, every orientation",
        ),
    ],
)
def test_words_for_other_sets_of_features(features: dict[str, float], words: str) -> None:
    assert describe(BoundObject("left", 0, features)) == words


@pytest.mark.parametrize(
    ("heading", "direction"),
    [
        ((0.3, 0.1), "right"),
        ((-0.3, 0.1), "left"),
        ((-0.3, -0.29), "left"),
        ((0.1, 0.3), "down"),
        ((0.1, -0.3), "up"),
        ((20.0, 30.0), "down"),
        ((0.0, 0.0), "up"),
    ],
)
def test_the_direction_is_the_main_one_of_the_heading_whatever_its_size(
    heading: tuple[float, float], direction: str
) -> None:
    assert BoundObject("red", 7, {"left": 1.0}, heading=heading).direction == direction
    assert BoundObject("red", 7, {"left": 1.0}).direction == "left"


def weights() -> torch.Tensor:
    """Objects of neurons 7 (right, 0°) and 8 (left, 60°)."""
    w = torch.zeros(10, 10, dtype=torch.float64)
    w[1, 7], w[4, 7], w[0, 8], w[5, 8] = 0.8, 0.4, 0.6, 0.5
    return w


def test_the_winner_is_chosen_among_owners() -> None:
    outputs, owners = torch.tensor([5.0, 1.0, 3.0, 2.0]), torch.tensor([False, True, False, True])
    for sign, own in ((1, 3), (-1, 1)):
        assert feature_weights(sign * outputs, ObjectTable(owners, torch.eye(4)), torch.ones(4))[1] == own


def test_feature_weights_are_the_winners_row() -> None:
    """[C eq. 11]"""
    outputs, scale = noise(10), 1 + noise(10, seed=1)
    outputs[7], outputs[8] = -0.2, -0.5
    table = object_table(weights())
    f, k = feature_weights(outputs, table, scale)
    assert k.item() == 7
    assert_allclose(f, [abs(outputs[7]) * table.rows[7, j] / scale[j] for j in range(10)])
    assert f.nonzero().flatten().tolist() == [1, 4, 7]


def test_mask_is_the_weighted_sum_of_fluctuations() -> None:
    """[C fig. 5]: motion and orientation into all planes, a color into its own."""
    f, images, low = noise(10), noise(10, 4, 5, seed=1), noise(10, 4, 5, seed=2)
    change = (f[:, None, None] * (images - low).abs()).numpy()
    first = GROUPS["color"].start
    planes = np.stack([change[:first].sum(0) + change[first + c] for c in range(3)])
    mask = attention_mask(f, images, low)
    assert_allclose(mask, planes / planes.max(), rtol=1e-12)
    assert mask.max() == 1


def scene(steps: int = 6, batch: tuple[int, ...] = ()) -> tuple[torch.Tensor, ...]:
    """Frames, feature images, outputs and scale."""
    return (
        noise(*batch, steps, 3, 4, 5),
        noise(*batch, steps, 10, 4, 5, seed=1),
        noise(*batch, steps, 10, seed=2) - 0.5,
        1 + noise(*batch, steps, 10, seed=3),
    )


def test_enhanced_frames_are_the_frames_times_the_mask() -> None:
    frames, images, outputs, scale = scene()
    (enhanced, k), state = Attention(0.02, tau=0.3)(frames, images, outputs, scale, object_table(weights()))
    table, low = object_table(weights()), images[0]
    for t in range(6):
        low = low + 0.02 / 0.32 * (images[t] - low)
        f, own = feature_weights(outputs[t], table, scale[t])
        assert_allclose(enhanced[t], frames[t] * attention_mask(f, images[t], low), atol=1e-12)
        assert k[t] == own
    assert_allclose(state.low, low, atol=1e-14)
