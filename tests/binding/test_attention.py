"""Visual attention: who wins, which images count, and what is enhanced."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.binding import Attention, object_table
from ndtorch.binding.attention import attention_mask, feature_weights, winner
from ndtorch.errors import InputError
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


def test_without_owners_nobody_wins() -> None:
    assert winner(torch.rand(2, 4), torch.zeros(2, 4, dtype=torch.bool)).tolist() == [-1, -1]


def test_winners_of_a_batch() -> None:
    owners = torch.tensor([[True, True], [False, True], [False, False]])
    found = winner(torch.tensor([[2.0, 1.0], [2.0, 1.0], [2.0, 1.0]]), owners)
    assert found.tolist() == [0, 1, -1]
    assert found.dtype == torch.int64


def test_feature_weights_are_the_winners_row() -> None:
    """[C eq. 11]"""
    outputs, scale = noise(10), 1 + noise(10, seed=1)
    outputs[7], outputs[8] = -0.2, -0.5
    table = object_table(weights())
    f, k = feature_weights(outputs, table, scale)
    assert k.item() == 7
    assert_allclose(f, [abs(outputs[7]) * table.rows[7, j] / scale[j] for j in range(10)])
    assert f.nonzero().flatten().tolist() == [1, 4, 7]


def test_feature_weights_are_zero_without_a_winner_or_a_scale() -> None:
    f, k = feature_weights(torch.ones(10), object_table(torch.zeros(10, 10)), torch.ones(10))
    assert k.item() == -1
    assert not f.any()
    f, _ = feature_weights(torch.ones(10).double(), object_table(weights()), torch.zeros(10).double())
    assert not f.any()


def test_feature_weights_of_a_batch() -> None:
    outputs, scale = noise(3, 2, 10), 1 + noise(3, 2, 10, seed=1)
    table = object_table(weights().expand(3, 2, 10, 10))
    f, k = feature_weights(outputs, table, scale)
    alone, own = feature_weights(outputs[2, 1], object_table(weights()), scale[2, 1])
    assert torch.equal(f[2, 1], alone)
    assert k[2, 1] == own


def test_mask_is_the_weighted_sum_of_fluctuations() -> None:
    """[C fig. 5]: motion and orientation into all planes, a color into its own."""
    f, images, low = noise(10), noise(10, 4, 5, seed=1), noise(10, 4, 5, seed=2)
    change = (f[:, None, None] * (images - low).abs()).numpy()
    first = GROUPS["color"].start
    planes = np.stack([change[:first].sum(0) + change[first + c] for c in range(3)])
    mask = attention_mask(f, images, low)
    assert_allclose(mask, planes / planes.max(), rtol=1e-12)
    assert mask.max() == 1


@pytest.mark.parametrize("color", [0, 1, 2])
def test_a_color_goes_only_into_its_own_plane(color: int) -> None:
    f = torch.zeros(10)
    f[GROUPS["color"].start + color] = 0.3
    mask = attention_mask(f, torch.rand(10, 4, 5), torch.zeros(10, 4, 5))
    others = [c for c in range(3) if c != color]
    assert mask[color].max() == 1
    assert not mask[others].any()


@pytest.mark.parametrize("feature", range(7))
def test_motion_and_orientation_go_into_all_planes(feature: int) -> None:
    f = torch.zeros(10)
    f[feature] = 0.3
    mask = attention_mask(f, torch.rand(10, 4, 5), torch.zeros(10, 4, 5))
    assert torch.equal(mask[0], mask[1])
    assert torch.equal(mask[0], mask[2])
    assert mask.max() == 1


def test_mask_without_weights_is_black() -> None:
    assert not attention_mask(torch.zeros(10), torch.rand(10, 4, 5), torch.zeros(10, 4, 5)).any()


def test_every_mask_of_a_batch_has_its_own_maximum() -> None:
    f, images, low = noise(3, 2, 10), noise(3, 2, 10, 4, 5, seed=1), noise(3, 2, 10, 4, 5, seed=2)
    mask = attention_mask(f, images, low)
    assert_allclose(mask.amax((-1, -2, -3)), np.ones((3, 2)))
    assert_allclose(mask[2, 1], attention_mask(f[2, 1], images[2, 1], low[2, 1]), rtol=1e-12)


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


def test_frames_are_black_where_nobody_owns_an_object() -> None:
    frames, images, outputs, scale = scene()
    (enhanced, k), _ = Attention(0.02)(frames, images, outputs, scale, object_table(torch.zeros(10, 10).double()))
    assert not enhanced.any()
    assert k.tolist() == [-1] * 6


def test_each_trial_of_a_batch_has_its_own_table() -> None:
    frames, images, outputs, scale = scene(batch=(2,))
    tables = torch.stack([weights(), torch.zeros(10, 10).double()])
    (enhanced, k), _ = Attention(0.02)(frames, images, outputs, scale, object_table(tables))
    (alone, own), _ = Attention(0.02)(*(x[0] for x in scene(batch=(2,))), object_table(weights()))
    assert_allclose(enhanced[0], alone, atol=1e-12)
    assert torch.equal(k[0], own)
    assert (k[1] == -1).all()


@pytest.mark.parametrize("length", [1, 4])
def test_chunks_give_the_whole(length: int) -> None:
    parts, module, state = scene(9), Attention(0.02), None
    (whole, k), end = module(*parts, object_table(weights()))
    frames, winners = [], []
    for chunk in zip(*(x.split(length) for x in parts), strict=True):
        (enhanced, own), state = module(*chunk, object_table(weights()), state)
        frames.append(enhanced)
        winners.append(own)
    assert state is not None
    assert_allclose(torch.cat(frames), whole, atol=1e-12)
    assert torch.equal(torch.cat(winners), k)
    assert torch.equal(state.low, end.low)


@pytest.mark.parametrize("shape", [(6, 9, 4, 5), (6, 10, 5, 4)])
def test_images_of_another_shape_are_refused(shape: tuple[int, ...]) -> None:
    frames, _, outputs, scale = scene()
    with pytest.raises(InputError, match=r"images must be \[\.\.\., T, 10, H, W\]"):
        Attention(0.02)(frames, torch.zeros(shape), outputs, scale, object_table(weights()))


def test_bad_time_constants_are_refused() -> None:
    with pytest.raises(InputError, match="dt"):
        Attention(0.0)
    with pytest.raises(InputError, match="tau"):
        Attention(0.1, tau=-1)
