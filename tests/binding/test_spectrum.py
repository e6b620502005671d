"""Spectral radius, weight matrices, solutions of source separation and their stability: by numpy and by print."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding import (
    InhibitoryNetwork,
    learning_rule,
    limit_spectral_radius,
    solutions,
    spectral_radius,
)
from ndtorch.binding.spectrum import always_limited
from ndtorch.binding.theory import count_solutions, largest_free_weight, mixing_from_weights
from ndtorch.errors import InputError

BATCHES = [1, 11]


def radius(weights: torch.Tensor) -> np.ndarray:
    return abs(np.linalg.eigvals(weights.double().numpy())).max(-1)


def sparse(rng: np.random.Generator, count: int, neurons: int, density: float) -> np.ndarray:
    """Non-negative matrices with zero diagonal and about `density` of the entries filled."""
    weights = rng.random((count, neurons, neurons)) * (rng.random((count, neurons, neurons)) < density)
    weights[:, range(neurons), range(neurons)] = 0
    return weights


def nilpotent(rng: np.random.Generator, count: int, neurons: int, density: float) -> np.ndarray:
    return np.triu(sparse(rng, count, neurons, density), 1) * 30


def cyclic(rng: np.random.Generator, count: int, neurons: int, density: float) -> np.ndarray:
    """One ring of inhibition: all eigenvalues have the same magnitude."""
    weights = np.zeros((count, neurons, neurons))
    weights[:, range(neurons), np.roll(range(neurons), 1)] = 0.1 + rng.random((count, neurons))
    return weights


def shuffled(rng: np.random.Generator, weights: np.ndarray) -> torch.Tensor:
    order = rng.permutation(weights.shape[-1])
    return torch.from_numpy(np.ascontiguousarray(weights[:, order][:, :, order]))


KINDS = st.sampled_from([sparse, nilpotent, cyclic])


def test_spectral_radius_of_known_matrices() -> None:
    weights = torch.tensor([[[0.0, 4.0], [9.0, 0.0]], [[0.0, 7.0], [0.0, 0.0]], [[0.0, -4.0], [1.0, 0.0]]])
    assert_allclose(spectral_radius(weights), [6, 0, 2], atol=1e-6)


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
        if rho <= limit * (1 - 1e-5):
            assert torch.equal(new, old)
        else:
            factor = float(new.max() / old.max())
            assert factor == pytest.approx(min(1.0, limit / rho), rel=1e-5)
            assert_allclose(new, old * factor, rtol=1e-5)


@pytest.mark.parametrize("kind", [sparse, cyclic])
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


coefficients = st.floats(0.05, 1.0)
matrices = st.tuples(coefficients, coefficients, coefficients, coefficients).filter(
    lambda m: abs(m[0] * m[3] - m[1] * m[2]) > 1e-6
)


def random_matrix(seed: int, *shape: int) -> torch.Tensor:
    return torch.rand(shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


@settings(max_examples=30, deadline=None)
@given(matrices)
def test_two_neurons_and_two_sources(m: tuple[float, float, float, float]) -> None:
    """[C eq. 21, 24]"""
    m11, m12, m21, m22 = m
    straight, swapped = solutions(torch.tensor([[m11, m12], [m21, m22]], dtype=torch.float64))
    assert (straight.owners, swapped.owners) == ((0, 1), (1, 0))
    assert_allclose(straight.weights, [[0, m12 / m22], [m21 / m11, 0]])
    assert_allclose(swapped.weights, [[0, m11 / m21], [m22 / m12, 0]])


@settings(max_examples=30, deadline=None)
@given(matrices)
def test_just_one_of_the_two_is_stable(m: tuple[float, float, float, float]) -> None:
    """[C eq. 31-32]"""
    m11, m12, m21, m22 = m
    assume(abs(m12 * m21 - m11 * m22) > 1e-6)
    straight, swapped = solutions(torch.tensor([[m11, m12], [m21, m22]], dtype=torch.float64))
    assert straight.stable == (m12 * m21 < m11 * m22)
    assert swapped.stable == (m12 * m21 > m11 * m22)


def test_one_source_and_two_neurons() -> None:
    """[C eq. 27-28]; the free weight is zero here."""
    found = solutions(torch.tensor([[0.8], [0.6]], dtype=torch.float64))
    assert [s.owners for s in found] == [(0,), (1,)]
    assert_allclose(found[0].weights, [[0, 0], [0.6 / 0.8, 0]])
    assert_allclose(found[1].weights, [[0, 0.8 / 0.6], [0, 0]])
    assert all(s.stable for s in found)


def test_sources_in_the_same_proportions_are_refused() -> None:
    with pytest.raises(InputError, match="same proportions"):
        solutions(torch.ones(2, 2, dtype=torch.int64))


@pytest.mark.parametrize(("neurons", "sources", "count"), [(10, 10, 3628800), (10, 2, 8100), (2, 1, 4), (2, 2, 2)])
def test_counts_of_the_paper(neurons: int, sources: int, count: int) -> None:
    assert count_solutions(neurons, sources) == count


@settings(max_examples=30, deadline=None)
@given(other=st.floats(0.01, 20), present=st.floats(0, 30))
def test_free_weight_of_two_neurons_is_one_over_the_other(other: float, present: float) -> None:
    """[C eq. 33-36]"""
    weights = torch.tensor([[0.0, present], [other, 0.0]], dtype=torch.float64)
    assert largest_free_weight(weights, 0, 1) == pytest.approx(1 / other)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**31), sources=st.integers(1, 4))
def test_mixing_comes_back_from_the_weights(seed: int, sources: int) -> None:
    """[C eq. 58]: up to the scale of each column."""
    mixing = 0.05 + random_matrix(seed, 4, sources)
    for solution in solutions(mixing):
        owners = torch.zeros(4, dtype=torch.bool)
        owners[list(solution.owners)] = True
        order = np.argsort(solution.owners)
        got = mixing_from_weights(solution.weights, owners).numpy()
        expected = (mixing / mixing[list(solution.owners), range(sources)]).numpy()[:, order]
        assert_allclose(got, expected, rtol=1e-10)


Mixing = tuple[tuple[float, float], tuple[float, float]]

ONE: Mixing = ((0.0, 0.7), (0.0, 0.6))
TWO: Mixing = ((0.6, 0.7), (0.7, 0.6))


def mixed(mixing: Mixing, seconds: float) -> torch.Tensor:
    """Mixture of two sinusoids, `[T, 2]`. [C eq. 42-43]"""
    t = torch.arange(round(seconds * 1000), dtype=torch.float64) * 0.001
    sources = torch.stack([torch.sin(2 * math.pi * 2 * t), torch.sin(2 * math.pi * t)], -1)
    return sources @ torch.tensor(mixing, dtype=torch.float64).T


def network(rule: str) -> InhibitoryNetwork:
    return InhibitoryNetwork(
        2, 0.001, learning_rule(rule, gamma=5.0, radius_limit=math.inf), tau_in=math.inf, tau_out=2.0, settle=0.0
    )


def test_cooperation_separates_two_sources() -> None:
    """[C eq. 52]: the outputs are the sources, and the weights near .86."""
    outputs, state = network("cooperative")(mixed(TWO, 20))
    assert_allclose(state.weights, [[0, 0.86], [0.86, 0]], atol=0.1)
    spectrum = torch.fft.rfft(outputs[-1000:], dim=0).abs()
    assert spectrum[:, 0].argmax() == 1
    assert spectrum[:, 1].argmax() == 2
    # In the mixture, the weaker source has 0.86 of the stronger.
    assert spectrum[2, 0] < 0.5 * spectrum[1, 0]
    assert spectrum[1, 1] < 0.5 * spectrum[2, 1]


def test_competition_cannot_separate_two_sources() -> None:
    """[C §5.4]: one neuron keeps being suppressed, far from the solution."""
    _, state = network("competitive")(mixed(TWO, 30))
    weights = state.weights[[0, 1], [1, 0]]
    assert weights.max() > 0.95
    assert weights.min() < 0.5


def test_cooperation_becomes_unstable_on_one_source() -> None:
    """[C fig. 7c]: weights grow together until the eigenvalues exceed one, after about nine seconds."""
    module, state, first = network("cooperative"), None, None
    for n, chunk in enumerate(mixed(ONE, 12).split(50)):
        _, state = module(chunk, state)
        if first is None and float(spectral_radius(state.weights)) > 1:
            first = (n + 1) * 0.05
    assert first is not None
    assert 8 < first < 11
