"""Learning rules by name, their functions, and the soft start."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.binding import ACTIVATIONS, InhibitoryNetwork, LearningRule, learning_rule
from ndtorch.binding.rules import RULES, ScaleFreeRule, cube, learning_onset

X = torch.tensor([-0.8, 0.1, 0.5], dtype=torch.float64)


def products(rule: LearningRule, fluctuation: torch.Tensor) -> torch.Tensor:
    """What one time step makes of every weight."""
    n = fluctuation.shape[-1]
    return rule.change(fluctuation.unsqueeze(-2), torch.zeros(n), torch.zeros(n, n))


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("cube", [-0.512, 0.001, 0.125]),
        ("tanh-pi", np.tanh(np.pi * X.numpy())),
        ("tanh-10", np.tanh(10 * X.numpy())),
        ("linear", X.numpy()),
    ],
)
def test_activations(name: str, values: list[float]) -> None:
    assert_allclose(ACTIVATIONS[name](X), values, rtol=1e-12)


def test_competitive_puts_the_cube_on_the_inhibiting_neuron() -> None:
    change = products(learning_rule("competitive"), X)
    for n in range(3):
        for k in range(3):
            assert change[n, k].item() == pytest.approx(math.tanh(math.pi * float(X[n])) * float(X[k]) ** 3)


def test_cooperative_is_the_competitive_rule_transposed() -> None:
    assert torch.equal(products(learning_rule("cooperative"), X), products(learning_rule("competitive"), X).mT)


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


def test_the_rate_falls_from_a_fast_start() -> None:
    rule = ScaleFreeRule()
    got = rule.rate(torch.tensor([-1.0, 0.0, 4.0, 100.0], dtype=torch.float64))
    assert_allclose(got, [0, 0, 0.2 * (1 + 15 * math.exp(-1)), 0.2], rtol=1e-6)


def test_a_rule_of_ones_own_has_a_name_like_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(RULES, "sign", lambda **constants: LearningRule(torch.sign, cube, "sign", **constants))
    network = InhibitoryNetwork(2, rule="sign", settle=0.0)
    assert network.constants.rule.name == "sign"
    _, state = network(torch.randn(50, 2, generator=torch.Generator().manual_seed(0)))
    assert state.weights.any()


def test_the_cooperative_rule_stays_finite_on_white_noise() -> None:
    """Its weights become nearly triangular there: then the spectral radius says nothing about their size."""
    noise = torch.randn(400, 10, generator=torch.Generator().manual_seed(0))
    outputs, state = InhibitoryNetwork(10, 0.01, "cooperative", settle=0.5)(noise)
    assert torch.isfinite(outputs).all()
    assert state.weights.max() > 0.5
