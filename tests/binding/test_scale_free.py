"""The scale-free rule: its bounds, its fixed points, scale invariance, chunks and batches."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding import ScaleFreeNetwork, ScaleFreeRule, settled
from ndtorch.errors import InputError
from tests.strategies import chunkings, in_chunks


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
    outputs, state = ScaleFreeNetwork(6, rule=rule, settle=0.1)(signals)
    weights = state.weights
    assert weights.any()
    assert weights.min() >= rule.lowest
    assert weights.max() <= rule.highest
    assert not weights.diagonal().any()
    assert torch.linalg.eigvals(weights.double().abs()).abs().max() <= rule.radius_limit + 1e-5
    assert torch.isfinite(outputs).all()


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), scale=st.sampled_from([1e-3, 0.125, 7.0, 1e4]))
def test_scaling_the_signals_changes_no_weight(seed: int, scale: float) -> None:
    signals = sources(400, seed) @ MIXING
    network = ScaleFreeNetwork(4)
    (plain, one), (scaled, other) = network(signals), network(scale * signals)
    assert_allclose(other.weights, one.weights, rtol=1e-6, atol=1e-9)
    assert_allclose(scaled, scale * plain, rtol=1e-6, atol=1e-9 * scale)


@settings(max_examples=15, deadline=None)
@given(lengths=chunkings(60))
def test_chunks_do_not_matter(lengths: list[int]) -> None:
    network, signals = ScaleFreeNetwork(4, settle=0.1), sources(60) @ MIXING
    whole, end = network(signals)
    parts, part_end = in_chunks(network, signals, lengths, -2)
    assert_allclose(parts, whole, rtol=1e-9, atol=1e-12)
    for one, other in zip(part_end, end, strict=True):
        assert torch.equal(one, other)


def test_a_batch_is_that_many_single_runs() -> None:
    network = ScaleFreeNetwork(4)
    signals = torch.stack([sources(200, seed) @ MIXING for seed in range(6)]).reshape(2, 3, 200, 4)
    outputs, state = network(signals)
    alone, end = network(signals[1, 2])
    assert_allclose(outputs[1, 2], alone, rtol=1e-8, atol=1e-10)
    assert_allclose(state.weights[1, 2], end.weights, rtol=1e-7, atol=1e-9)


def test_outputs_solve_the_feedback() -> None:
    signals = sources(300) @ MIXING
    network = ScaleFreeNetwork(4)
    _, state = network(signals)
    outputs, _ = network(signals[:1], state)
    assert_allclose(outputs + outputs @ state.weights.T, signals[:1], atol=1e-10)


def test_one_source_leaves_one_output() -> None:
    """The strongest neuron keeps the source; weights to the others are their shares of it."""
    signals = sources(6000, count=1) @ torch.tensor([[0.3, 1.0, 0.6]], dtype=torch.float64)
    outputs, state = ScaleFreeNetwork(3)(signals)
    assert_allclose(state.weights[:, 1], [0.3, 0.0, 0.6], atol=0.02)
    assert outputs[-500:].std(0)[[0, 2]].max() < 0.05 * outputs[-500:, 1].std()


def test_stronger_outputs_are_taken_out_of_weaker_ones() -> None:
    """At the fixed point a weaker output does not correlate with the outputs of stronger neurons."""
    strong, weak = sources(12000).unbind(-1)
    outputs, state = ScaleFreeNetwork(2)(torch.stack([3 * strong, weak + 0.9 * strong], -1))
    correlation = torch.corrcoef(outputs[-3000:].T)[0, 1]
    assert abs(correlation) < 0.1
    assert abs(state.weights[1, 0] - 0.3) < 0.1
    assert abs(state.weights[0, 1]) < 0.1


def test_zero_learns_nothing() -> None:
    outputs, state = ScaleFreeNetwork(4)(torch.zeros(300, 4))
    assert not outputs.any()
    assert not state.weights.any()


def test_the_gate_lets_the_stronger_inhibit_the_weaker() -> None:
    rule = ScaleFreeRule()
    change = rule.change(torch.ones(2, 2), torch.tensor([1.0, 16.0]), torch.zeros(2, 2))
    # s = 1 and 4: c[0, 1] = 256 / 257 over s_1^2 = 16, c[1, 0] = 1 / 257 over 1.
    assert_allclose(change[0, 1], 256 / 257 / 16, rtol=1e-6)
    assert_allclose(change[1, 0], 1 / 257, rtol=1e-5)


def test_the_rate_falls_from_a_fast_start() -> None:
    rule = ScaleFreeRule()
    assert rule.rate(0.0) == rule.rate(-1.0) == 0.0
    assert rule.rate(4.0) == pytest.approx(0.2 * (1 + 15 * math.exp(-1)), rel=1e-6)
    assert rule.rate(100.0) == pytest.approx(0.2)


def test_settled_is_the_inverse() -> None:
    weights = torch.tensor([[0.0, 0.5], [0.2, 0.0]])
    assert_allclose(settled(weights) @ (torch.eye(2) + weights), torch.eye(2), atol=1e-6)


def test_other_widths_are_refused() -> None:
    with pytest.raises(InputError, match=r"inputs must be \[..., T, 4\], got \(10, 3\)"):
        ScaleFreeNetwork(4)(torch.zeros(10, 3))
    with pytest.raises(InputError, match="at least 2 neurons, got 1"):
        ScaleFreeNetwork(1)
