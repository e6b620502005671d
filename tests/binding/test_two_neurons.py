"""The two-neuron experiments of [C §5.4]: 1 ms steps, learning rate 5, sources of 2 Hz and 1 Hz."""

from __future__ import annotations

import functools
import math

import torch
from numpy.testing import assert_allclose

from ndtorch.binding import InhibitoryNetwork, learning_rule, solutions, spectral_radius
from ndtorch.binding.learning import NetworkState

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


@functools.cache
def learn(rule: str, mixing: Mixing, seconds: float) -> tuple[torch.Tensor, NetworkState]:
    """Outputs and state after `seconds`."""
    return network(rule)(mixed(mixing, seconds))


def test_competition_finds_the_one_source_within_five_seconds() -> None:
    """[C eq. 50, fig. 7e]"""
    _, state = learn("competitive", ONE, 5)
    assert_allclose(state.weights, [[0, 0.2], [0.86, 0]], atol=0.02)


def test_competition_leaves_one_output_of_one_source() -> None:
    """[C fig. 7f]"""
    outputs, state = learn("competitive", ONE, 10)
    last = outputs[-1000:].abs().amax(0)
    assert last[0] > 0.6
    assert last[1] < 0.02
    assert float(spectral_radius(state.weights)) < 1


def test_the_weights_found_are_the_solution_with_its_other_weight_in_bounds() -> None:
    """[C eq. 29, 35]"""
    _, state = learn("competitive", ONE, 10)
    expected = solutions(torch.tensor(ONE, dtype=torch.float64)[:, 1:])[0].weights
    assert_allclose(state.weights[1, 0], expected[1, 0], atol=0.005)
    assert 0 <= state.weights[0, 1] < 0.7 / 0.6


def test_cooperation_separates_two_sources() -> None:
    """[C eq. 52]: the outputs are the sources, and the weights near .86."""
    outputs, state = learn("cooperative", TWO, 20)
    assert_allclose(state.weights, [[0, 0.86], [0.86, 0]], atol=0.1)
    spectrum = torch.fft.rfft(outputs[-1000:], dim=0).abs()
    assert spectrum[:, 0].argmax() == 1
    assert spectrum[:, 1].argmax() == 2
    # In the mixture, the weaker source has 0.86 of the stronger.
    assert spectrum[2, 0] < 0.5 * spectrum[1, 0]
    assert spectrum[1, 1] < 0.5 * spectrum[2, 1]


def test_competition_cannot_separate_two_sources() -> None:
    """[C §5.4]: one neuron keeps being suppressed, far from the solution."""
    _, state = learn("competitive", TWO, 30)
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
