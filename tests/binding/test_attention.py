"""Visual attention: who wins, which images count, and what is enhanced."""

from __future__ import annotations

import numpy as np
import torch
from numpy.testing import assert_allclose

from ndtorch.binding import Attention, object_table
from ndtorch.binding.attention import attention_mask, feature_weights, winner
from ndtorch.vision import GROUPS


def noise(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def weights() -> torch.Tensor:
    """Objects of neurons 7 (right, 0°) and 8 (left, 60°)."""
    w = torch.zeros(10, 10, dtype=torch.float64)
    w[1, 7], w[4, 7], w[0, 8], w[5, 8] = 0.8, 0.4, 0.6, 0.5
    return w


def test_the_winner_is_chosen_among_owners() -> None:
    outputs, owners = torch.tensor([5.0, 1.0, 3.0, 2.0]), torch.tensor([False, True, False, True])
    assert winner(outputs, owners).item() == 3
    assert winner(-outputs, owners).item() == 1


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
