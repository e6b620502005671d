"""Settled feedback: the scale-free network alone, and shared by many fields."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding import InhibitoryNetwork, learning_rule, spectral_radius
from ndtorch.binding.rules import BOUNDS, ScaleFreeRule


def sources(steps: int, seed: int = 0, count: int = 2) -> torch.Tensor:
    """Independent signals up to about 2 Hz, of unit deviation, `[T, count]`, 100 samples a second."""
    noise = torch.randn(steps + 400, count, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    hertz = torch.fft.rfftfreq(len(noise), 0.01).double()
    spectrum = torch.fft.rfft(noise, dim=0) * torch.exp(-((hertz / 2) ** 2))[:, None]
    smooth = torch.fft.irfft(spectrum, n=len(noise), dim=0)[:steps]
    return smooth / smooth.std(0)


MIXING = torch.tensor([[1.0, 0.8, 0.0, 0.3], [0.0, 0.5, 0.7, 0.6]], dtype=torch.float64)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), gamma=st.floats(0.1, 50.0), size=st.floats(1e-3, 1e3))
def test_weights_keep_their_bounds(seed: int, gamma: float, size: float) -> None:
    rule = ScaleFreeRule(gamma=gamma)
    signals = size * torch.randn(300, 6, generator=torch.Generator().manual_seed(seed))
    outputs, state = InhibitoryNetwork.scale_free(6, rule=rule, settle=0.1)(signals)
    weights = state.weights
    assert weights.any()
    assert BOUNDS[0] <= weights.min() <= weights.max() <= BOUNDS[1]
    assert not weights.diagonal().any()
    assert torch.linalg.eigvals(weights.double().abs()).abs().max() <= rule.radius_limit + 1e-5
    assert torch.isfinite(outputs).all()


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), scale=st.sampled_from([1e-3, 0.125, 7.0, 1e4]))
def test_scaling_the_signals_changes_no_weight(seed: int, scale: float) -> None:
    signals = sources(400, seed) @ MIXING
    network = InhibitoryNetwork.scale_free(4)
    (plain, one), (scaled, other) = network(signals), network(scale * signals)
    assert_allclose(other.weights, one.weights, rtol=1e-6, atol=1e-9)
    assert_allclose(scaled, scale * plain, rtol=1e-6, atol=1e-9 * scale)


def test_outputs_solve_the_feedback() -> None:
    signals = sources(300) @ MIXING
    network = InhibitoryNetwork.scale_free(4)
    _, state = network(signals)
    outputs, _ = network(signals[:1], state)
    assert_allclose(outputs + outputs @ state.weights.T, signals[:1], atol=1e-10)


def test_one_source_leaves_one_output() -> None:
    """The strongest neuron keeps the source; weights to the others are their shares of it."""
    signals = sources(6000, count=1) @ torch.tensor([[0.3, 1.0, 0.6]], dtype=torch.float64)
    outputs, state = InhibitoryNetwork.scale_free(3)(signals)
    assert_allclose(state.weights[:, 1], [0.3, 0.0, 0.6], atol=0.02)
    assert outputs[-500:].std(0)[[0, 2]].max() < 0.05 * outputs[-500:, 1].std()


def test_stronger_outputs_are_taken_out_of_weaker_ones() -> None:
    """At the fixed point a weaker output does not correlate with the outputs of stronger neurons."""
    strong, weak = sources(12000).unbind(-1)
    outputs, state = InhibitoryNetwork.scale_free(2)(torch.stack([3 * strong, weak + 0.9 * strong], -1))
    correlation = torch.corrcoef(outputs[-3000:].T)[0, 1]
    assert abs(correlation) < 0.1
    assert abs(state.weights[1, 0] - 0.3) < 0.1
    assert abs(state.weights[0, 1]) < 0.1


UP, DOWN, RED, BLUE = 3, 2, 7, 9


def two_things(steps: int = 80) -> torch.Tensor:
    """A red one that moves up through fields 0-3 and a blue one that moves down through fields 8-5, `[T, 12, 10]`."""
    signals = torch.zeros(steps, 12, 10)
    for n in range(10, steps):
        for start, way, features in ((0, 1, (UP, RED)), (8, -1, (DOWN, BLUE))):
            place = start + way * 3 * (n - 10) / (steps - 10)
            for f in range(12):
                weight = max(0.0, 1 - abs(f - place))
                signals[n, f, features[0]] = 0.3 * weight
                signals[n, f, features[1]] = 0.4 * weight
    return signals


def of_fields(dt: float = 0.04, rule: ScaleFreeRule | None = ScaleFreeRule()) -> InhibitoryNetwork:  # noqa: B008
    taus = {"tau_in": torch.inf, "tau_out": 2.0}
    return InhibitoryNetwork(10, dt, rule, "settled", shared=True, settle=0.0, faint=0.05, **taus)


def test_features_of_the_same_place_are_bound_and_others_are_not() -> None:
    _, state = of_fields()(3 * two_things())
    bound = torch.maximum(state.weights, state.weights.mT)
    assert bound[UP, RED] > 0.3
    assert bound[DOWN, BLUE] > 0.3
    for one, other in ((UP, BLUE), (DOWN, RED), (UP, DOWN), (RED, BLUE)):
        assert bound[one, other] < 0.1


@pytest.mark.parametrize("rule", ["competitive", "scale-free"])
@pytest.mark.parametrize("feedback", ["delayed", "settled"])
@pytest.mark.parametrize("shared", [False, True])
def test_any_rule_goes_with_any_feedback(rule: str, feedback: str, shared: bool) -> None:
    """And learns that the second neuron carries what the first does, in one field as in three."""
    common = sources(1500, count=1).float().tanh() * torch.tensor([0.9, 0.6, 0.0])
    inputs = common.unsqueeze(-2).expand(-1, 3, -1) if shared else common
    network = InhibitoryNetwork(
        3,
        0.01,
        learning_rule(rule, gamma=2.0),
        feedback,
        shared,
        every=0.05 if feedback == "settled" else 0,
        settle=0.5,
    )
    outputs, state = network(inputs)
    assert outputs.shape == inputs.shape
    assert state.weights[1, 0] > 0.1
    assert state.weights[1, 0] > 2 * state.weights[2].abs().max()
    assert float(spectral_radius(state.weights.abs())) <= 0.9501
