"""Solutions of blind source separation and their stability, against the printed equations."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding import separated, solutions, spectral_radius
from ndtorch.binding.theory import count_solutions, largest_free_weight, mixing_from_weights
from ndtorch.errors import InputError

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


def test_the_other_source_and_two_neurons() -> None:
    """[C eq. 29-30], with the mixture of [C eq. 44]."""
    permuted, straight = solutions(torch.tensor([[0.7], [0.6]], dtype=torch.float64))
    assert_allclose(straight.weights, [[0, 0.7 / 0.6], [0, 0]])
    assert_allclose(permuted.weights, [[0, 0], [0.6 / 0.7, 0]])


def test_the_mixture_of_the_paper_has_equal_weights() -> None:
    """[C eq. 51-52]"""
    stable = [s for s in solutions(torch.tensor([[0.6, 0.7], [0.7, 0.6]])) if s.stable]
    assert len(stable) == 1
    assert_allclose(stable[0].weights, [[0, 0.857], [0.857, 0]], atol=1e-3)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31), neurons=st.integers(2, 5), data=st.data())
def test_every_solution_separates(seed: int, neurons: int, data: st.DataObject) -> None:
    sources = data.draw(st.integers(1, neurons))
    mixing = 0.05 + random_matrix(seed, neurons, sources)
    assume(np.linalg.cond(mixing.numpy()) < 1e3)
    found = solutions(mixing)
    assert len(found) == math.perm(neurons, sources)
    for solution in found:
        gains = separated(mixing, solution.weights).numpy()
        expected = np.zeros_like(gains)
        for j, owner in enumerate(solution.owners):
            expected[owner, j] = mixing[owner, j]
        assert_allclose(gains, expected, atol=1e-9)


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


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**31), size=st.floats(0.05, 0.3))
def test_the_largest_free_weight_makes_the_radius_one(seed: int, size: float) -> None:
    weights = random_matrix(seed, 4, 4).fill_diagonal_(0) * size
    bound = largest_free_weight(weights, 2, 1)
    weights[2, 1] = bound
    assert float(spectral_radius(weights)) == pytest.approx(1)
    weights[2, 1] = 0.99 * bound
    assert float(spectral_radius(weights)) < 1


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
