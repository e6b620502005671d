"""Telling sources apart by delays."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding.readout.delays import delay_statistics, diagonalise, separate
from ndtorch.errors import InputError

BARS = torch.zeros(2, 10)
BARS[0, [1, 2, 4, 6, 7]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])
BARS[1, [0, 2, 4, 5, 8]] = torch.tensor([1.0, 0.6, 0.7, 0.7, 0.9])


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.integers(2, 6))
def test_common_diagonal_is_found(seed: int, size: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    basis = torch.linalg.qr(torch.randn(1, size, size, generator=generator, dtype=torch.float64)).Q
    diagonal = torch.randn(1, 4, size, generator=generator, dtype=torch.float64)
    rotation, result = diagonalise(basis.unsqueeze(1) @ torch.diag_embed(diagonal) @ basis.mT.unsqueeze(1))
    assert_allclose(rotation.mT @ rotation, torch.eye(size).expand(1, size, size), atol=1e-9)
    assert_allclose(result, torch.diag_embed(result.diagonal(dim1=-2, dim2=-1)), atol=1e-5)


def test_delays_find_the_mixing_of_known_sources() -> None:
    t = torch.arange(4000, dtype=torch.float64) / 100
    light = torch.stack([torch.sin(5 * t), torch.sin(9 * t + 1), torch.sign(torch.sin(3.3 * t))], -1)
    mixing = torch.rand(3, 10, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    state = delay_statistics()(light @ mixing)
    found = separate(state.covariances[1])
    assert int(found.sources) == 3
    likeness = (
        torch.nn.functional.normalize(found.mixing[:3].double(), dim=-1) @ torch.nn.functional.normalize(mixing).T
    )
    assert_allclose(likeness.amax(-1), torch.ones(3), atol=0.01)
    assert sorted(likeness.argmax(-1).tolist()) == [0, 1, 2]


def test_white_noise_is_not_in_the_delayed_covariances() -> None:
    noise = torch.randn(20000, 4, generator=torch.Generator().manual_seed(0))
    state = delay_statistics(tau_slow=60.0)(noise)
    assert state.covariances[1].abs().max() < 0.1


def test_equal_rates_are_said_to_be_indistinct() -> None:
    t = torch.arange(3000) / 100
    light = torch.stack([torch.sin(5 * t), torch.sin(5 * t + 1.5)], -1)
    other_rates = torch.stack([torch.sin(5.5 * t), torch.sin(8.2 * t + 1.5)], -1)
    gap = separate(delay_statistics()(light @ BARS).covariances[1]).gap
    other = separate(delay_statistics()(other_rates @ BARS).covariances[1]).gap
    assert gap < 0.02 < other


def test_nothing_is_no_source() -> None:
    assert int(separate(delay_statistics()(torch.zeros(200, 10)).covariances[1]).sources) == 0


def test_delays_of_nothing_are_refused() -> None:
    with pytest.raises(InputError, match="delays must be positive"):
        delay_statistics(delays=(0.0,))
