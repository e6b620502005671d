"""Normalisation, learning rules and covariances."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ndtorch.binding import BindingInputs, InhibitoryNetwork, LearningRule, learning_rule
from ndtorch.binding.normalise import ORDERS, Order, divide
from ndtorch.binding.rules import RULES, ScaleFreeRule, cube, learning_onset
from tests.strategies import noise

EDGES = [(0, 4), (4, 7), (7, 10)]


def reference(
    sums: np.ndarray, order: str, tau: float, dt: float, window: int, floor: float
) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and scale, `[T, 10]` each, one number after the other."""
    inputs, scale = np.zeros_like(sums), np.zeros_like(sums)
    fluctuations = np.zeros_like(sums)
    for a, b in EDGES:
        low = None
        for t in range(len(sums)):
            recent = slice(max(0, t - window + 1), t + 1)
            raw = max(sums[recent, a:b].max(), sums[0, a:b].max() if t < window else -np.inf)
            scale[t, a:b] = raw
            x = sums[t, a:b] / raw if order == "printed" else sums[t, a:b]
            low = x if low is None else low + dt / (tau + dt) * (x - low)
            fluctuations[t, a:b] = x - low
            if order == "printed":
                inputs[t, a:b] = fluctuations[t, a:b]
            else:
                divisor = max(abs(fluctuations[recent, a:b]).max(), floor * raw)
                inputs[t, a:b] = fluctuations[t, a:b] / divisor
    return inputs, scale


@pytest.mark.parametrize("order", ORDERS)
def test_inputs_and_scale_are_those_of_a_loop(order: Order) -> None:
    sums = 5 + noise(60, 10)
    (inputs, scale), _ = BindingInputs(0.02, order, tau=0.3, window=0.4, floor=0.02)(sums)
    expected = reference(sums.numpy(), order, 0.3, 0.02, 20, 0.02)
    assert_allclose(inputs, expected[0], atol=1e-12)
    assert_allclose(scale, expected[1])


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**31), scale=st.floats(1e-6, 1e6), floor=st.sampled_from([0.0, 0.01, 1.0]))
def test_filtered_inputs_never_exceed_one(seed: int, scale: float, floor: float) -> None:
    sums = (noise(50, 10, seed=seed).float() ** 4) * scale
    (inputs, _), _ = BindingInputs(0.05, window=0.3, floor=floor)(sums)
    assert inputs.abs().max() <= 1


@pytest.mark.parametrize("order", ORDERS)
def test_a_silent_group_stays_zero(order: Order) -> None:
    sums = noise(30, 10)
    sums[:, :4] = 0
    (inputs, scale), _ = BindingInputs(order=order)(sums)
    assert not inputs[:, :4].any()
    assert not scale[:, :4].any()
    assert torch.isfinite(inputs).all()


def test_fluctuations_below_the_floor_are_not_blown_up() -> None:
    sums = 100 + 1e-4 * noise(200, 10)
    (quiet, _), _ = BindingInputs(floor=0.01)(sums)
    (loud, _), _ = BindingInputs(floor=0.0)(sums)
    assert quiet.abs().max() < 1e-4
    assert loud.abs().max() == 1


@pytest.mark.parametrize("order", ORDERS)
def test_gradients(order: Order) -> None:
    module = BindingInputs(0.05, order, window=0.2)
    sums = (1 + noise(6, 10)).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: module(x)[0], (sums,))


def test_division_by_zero_is_zero_and_has_a_gradient() -> None:
    signals = torch.tensor([3.0, 4.0], requires_grad=True)
    out = divide(signals, torch.tensor([0.0, 2.0]))
    out.sum().backward()
    assert out.tolist() == [0, 2]
    assert signals.grad is not None
    assert signals.grad.tolist() == [0, 0.5]


X = torch.tensor([-0.8, 0.1, 0.5], dtype=torch.float64)


def products(rule: LearningRule, fluctuation: torch.Tensor) -> torch.Tensor:
    """What one time step makes of every weight."""
    n = fluctuation.shape[-1]
    return rule.change(fluctuation.unsqueeze(-2), torch.zeros(n), torch.zeros(n, n))


@pytest.mark.parametrize("f", ["cube", "linear"])
def test_hebbian_is_the_product_whatever_f_and_g_are(f: str) -> None:
    assert_allclose(products(learning_rule("hebbian", f=f, g="tanh-10"), X), np.outer(X, X))


def test_change_of_several_steps_is_their_mean() -> None:
    rule, high = learning_rule("competitive"), torch.rand(4, 3, dtype=torch.float64)
    mean = sum(products(rule, x) for x in high) / 4
    assert_allclose(rule.change(high, torch.zeros(3), torch.zeros(3, 3), 4), mean, rtol=1e-12)
    # Two steps of two fields: the fields are summed.
    assert_allclose(rule.change(high, torch.zeros(3), torch.zeros(3, 3), 2), 2 * mean, rtol=1e-12)


@pytest.mark.parametrize(
    ("seconds", "tau", "mu"),
    [(-1, 2, 0), (0, 2, 0), (2, 2, 1 - 1 / math.e), (200, 2, 1), (0, 0, 0), (1e-9, 0, 1), (1, math.inf, 0)],
)
def test_onset(seconds: float, tau: float, mu: float) -> None:
    assert float(learning_onset(torch.tensor(seconds, dtype=torch.float64), tau)) == pytest.approx(mu)


def test_the_gate_lets_the_stronger_inhibit_the_weaker() -> None:
    rule = ScaleFreeRule()
    change = rule.change(torch.ones(1, 2), torch.tensor([1.0, 16.0]), torch.zeros(2, 2))
    # s = 1 and 4: c[0, 1] = 256 / 257 over s_1^2 = 16, c[1, 0] = 1 / 257 over 1.
    assert_allclose(change[0, 1], 256 / 257 / 16, rtol=1e-6)
    assert_allclose(change[1, 0], 1 / 257, rtol=1e-5)


def test_a_rule_of_ones_own_has_a_name_like_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(RULES, "sign", lambda **constants: LearningRule(torch.sign, cube, "sign", **constants))
    network = InhibitoryNetwork(2, rule="sign", settle=0.0)
    assert network.rule.name == "sign"
    _, state = network(torch.randn(50, 2, generator=torch.Generator().manual_seed(0)))
    assert state.weights.any()


def test_the_cooperative_rule_stays_finite_on_white_noise() -> None:
    """Its weights become nearly triangular there: then the spectral radius says nothing about their size."""
    noise = torch.randn(400, 10, generator=torch.Generator().manual_seed(0))
    outputs, state = InhibitoryNetwork(10, 0.01, "cooperative", settle=0.5)(noise)
    assert torch.isfinite(outputs).all()
    assert state.weights.max() > 0.5
