"""The spectral radius against numpy's eigenvalues, and the limit on it."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding import limit_spectral_radius, spectral_radius
from ndtorch.binding.spectrum import SQUARING_FROM, always_limited, perron_root

# Batches that go to the eigenvalue solver, and batches that are squared.
BATCHES = [1, SQUARING_FROM - 1, SQUARING_FROM, SQUARING_FROM + 9]


def radius(weights: torch.Tensor) -> np.ndarray:
    return abs(np.linalg.eigvals(weights.double().numpy())).max(-1)


def sparse(rng: np.random.Generator, count: int, neurons: int, density: float) -> np.ndarray:
    """Non-negative matrices with zero diagonal and about `density` of the entries filled."""
    weights = rng.random((count, neurons, neurons)) * (rng.random((count, neurons, neurons)) < density)
    weights[:, range(neurons), range(neurons)] = 0
    return weights


def nilpotent(rng: np.random.Generator, count: int, neurons: int, density: float) -> np.ndarray:
    return np.triu(sparse(rng, count, neurons, density), 1) * 30


def blocks(rng: np.random.Generator, count: int, neurons: int, density: float) -> np.ndarray:
    """Groups of neurons that do not meet, of very different radii."""
    weights = sparse(rng, count, neurons, 0.9)
    half = neurons // 2
    weights[:, :half, half:] = weights[:, half:, :half] = 0
    weights[:, :half, :half] *= 1e-3
    return weights


def reducible(rng: np.random.Generator, count: int, neurons: int, density: float) -> np.ndarray:
    """Two groups, the one driving the other."""
    weights = sparse(rng, count, neurons, 0.9)
    weights[:, neurons // 2 :, : neurons // 2] = 0
    return weights


def cyclic(rng: np.random.Generator, count: int, neurons: int, density: float) -> np.ndarray:
    """One ring of inhibition: all eigenvalues have the same magnitude."""
    weights = np.zeros((count, neurons, neurons))
    weights[:, range(neurons), np.roll(range(neurons), 1)] = 0.1 + rng.random((count, neurons))
    return weights


def shuffled(rng: np.random.Generator, weights: np.ndarray) -> torch.Tensor:
    order = rng.permutation(weights.shape[-1])
    return torch.from_numpy(np.ascontiguousarray(weights[:, order][:, :, order]))


KINDS = st.sampled_from([sparse, nilpotent, blocks, reducible, cyclic])


def test_spectral_radius_of_known_matrices() -> None:
    weights = torch.tensor([[[0.0, 4.0], [9.0, 0.0]], [[0.0, 7.0], [0.0, 0.0]], [[0.0, -4.0], [1.0, 0.0]]])
    assert_allclose(spectral_radius(weights), [6, 0, 2], atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    kind=KINDS,
    count=st.sampled_from(BATCHES),
    neurons=st.integers(2, 10),
    density=st.floats(0.1, 1),
)
def test_perron_root_is_the_radius(seed: int, kind, count: int, neurons: int, density: float) -> None:
    rng = np.random.default_rng(seed)
    weights = shuffled(rng, kind(rng, count, neurons, density))
    got, expected = perron_root(weights).numpy(), radius(weights)
    assert (got >= expected * (1 - 1e-9) - 1e-12).all()
    assert (got <= expected * (1 + 2e-4) + 1e-12).all()


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    kind=KINDS,
    count=st.sampled_from(BATCHES),
    neurons=st.integers(2, 10),
    density=st.floats(0.1, 1),
    size=st.sampled_from([1e-6, 0.1, 1.0, 50.0, 1e12]),
    limit=st.sampled_from([0.3, 0.9, 0.95, 1.0]),
    dtype=st.sampled_from([torch.float32, torch.float64]),
)
def test_limit_holds_and_scales_uniformly(
    seed: int, kind, count: int, neurons: int, density: float, size: float, limit: float, dtype: torch.dtype
) -> None:
    rng = np.random.default_rng(seed)
    weights = (shuffled(rng, kind(rng, count, neurons, density)) * size).to(dtype)
    limited = limit_spectral_radius(weights, limit)
    assert (radius(limited) <= limit * (1 + 1e-6)).all()
    before = radius(weights)
    for old, new, rho in zip(weights, limited, before, strict=True):
        if rho <= limit * (1 - 2e-4):
            assert torch.equal(new, old)
        else:
            factor = float(new.max() / old.max())
            assert factor == pytest.approx(min(1.0, limit / rho), rel=2e-4)
            assert_allclose(new, old * factor, rtol=1e-5)


@pytest.mark.parametrize("kind", [sparse, blocks, reducible, cyclic])
@pytest.mark.parametrize("limit", [0.3, 0.95, 1.5])
def test_what_is_compiled_limits_as_what_decides(kind, limit: float) -> None:
    """On either side of the limit, and with a matrix of no numbers among them, which stays as it is."""
    rng = np.random.default_rng(5)
    weights = shuffled(rng, kind(rng, 12, 6, 0.5))
    size = torch.tensor([1e-3, 0.2, 0.5, 1.0, 3.0, 100.0], dtype=torch.float64).repeat(2)
    weights = weights * size[:, None, None] / radius(weights).max()
    weights[7, 2, 3] = float("inf")
    good = torch.arange(12) != 7
    limited = always_limited(weights, limit)
    assert torch.equal(limited[7], weights[7])
    assert limited.dtype == torch.float64
    assert (radius(limited[good]) <= limit).all()
    assert_allclose(limited[good], limit_spectral_radius(weights[good], limit), rtol=2e-4)
    assert_allclose(always_limited(weights.float(), limit)[good], limited[good], rtol=1e-5, atol=1e-12)
    inside = good & torch.from_numpy(radius(weights.nan_to_num(posinf=0.0)) < limit * (1 - 1e-3))
    assert torch.equal(limited[inside], weights[inside])


@pytest.mark.parametrize("count", BATCHES)
def test_weights_inside_the_limit_are_the_very_same_tensor(count: int) -> None:
    weights = torch.rand(count, 10, 10) * 0.05
    assert limit_spectral_radius(weights, 0.95) is weights


@pytest.mark.parametrize("count", BATCHES)
@pytest.mark.parametrize(("dtype", "size"), [(torch.float32, 1e20), (torch.float64, 1e160)])
def test_huge_weights_among_zeros_are_limited_too(count: int, dtype: torch.dtype, size: float) -> None:
    """Their squares overflow, and infinity times zero is not a number."""
    weights = torch.tensor([[0.0, size], [size, 0.0]], dtype=dtype).repeat(count, 1, 1)
    assert_allclose(radius(limit_spectral_radius(weights, 0.95)), 0.95, rtol=2e-4)


def test_gradients_pass_through_the_scaling() -> None:
    weights = torch.rand(4, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0)).requires_grad_()
    limit_spectral_radius(weights, 0.5).sum().backward()
    assert weights.grad is not None
    assert torch.isfinite(weights.grad).all()
