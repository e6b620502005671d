"""Learning rules by name, their functions, and the soft start."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose

from ndtorch.binding import ACTIVATIONS, RULE_NAMES, LearningRule, learning_onset, learning_rule
from ndtorch.errors import InputError

X = torch.tensor([-0.8, 0.1, 0.5], dtype=torch.float64)


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


def test_activations_are_exactly_these() -> None:
    assert set(ACTIVATIONS) == {"cube", "tanh-pi", "tanh-10", "linear"}


@pytest.mark.parametrize("name", list(ACTIVATIONS))
def test_activations_are_odd_and_differentiable(name: str) -> None:
    assert torch.equal(ACTIVATIONS[name](-X), -ACTIVATIONS[name](X))
    assert torch.autograd.gradcheck(ACTIVATIONS[name], (X.clone().requires_grad_(),))


def test_competitive_puts_the_cube_on_the_inhibiting_neuron() -> None:
    change = learning_rule("competitive").change(X)
    for n in range(3):
        for k in range(3):
            assert change[n, k].item() == pytest.approx(math.tanh(math.pi * float(X[n])) * float(X[k]) ** 3)


def test_cooperative_is_the_competitive_rule_transposed() -> None:
    assert torch.equal(learning_rule("cooperative").change(X), learning_rule("competitive").change(X).mT)


@pytest.mark.parametrize("f", ["cube", "linear"])
def test_hebbian_is_the_product_whatever_f_and_g_are(f: str) -> None:
    assert_allclose(learning_rule("hebbian", f=f, g="tanh-10").change(X), np.outer(X, X))


def test_functions_can_be_chosen() -> None:
    rule = learning_rule("competitive", f="linear", g="tanh-10")
    assert_allclose(rule.change(X), np.outer(np.tanh(10 * X.numpy()), X))


def test_change_of_a_batch_is_each_ones_own() -> None:
    fluctuation = torch.rand(2, 5, 3)
    change = learning_rule("competitive").change(fluctuation)
    assert change.shape == (2, 5, 3, 3)
    assert torch.equal(change[1, 4], learning_rule("competitive").change(fluctuation[1, 4]))


def test_a_rule_can_be_made_of_any_two_functions() -> None:
    rule = LearningRule(torch.sign, torch.abs)
    assert rule.name == "custom"
    assert rule.change(torch.tensor([-2.0, 3.0])).tolist() == [[-2, -3], [2, 3]]


@pytest.mark.parametrize("name", RULE_NAMES)
def test_rules_carry_their_names(name: str) -> None:
    assert learning_rule(name).name == name


def test_unknown_names_are_refused() -> None:
    with pytest.raises(InputError, match=r"rule must be one of competitive, cooperative, hebbian .*, got 'oja'"):
        learning_rule("oja")
    with pytest.raises(InputError, match=r"^f must be one of cube, .* got 'square'"):
        learning_rule("competitive", f="square")
    with pytest.raises(InputError, match=r"^g must be one of cube, .* got 'relu'"):
        learning_rule("hebbian", g="relu")


@pytest.mark.parametrize(
    ("seconds", "tau", "mu"),
    [(-1, 2, 0), (0, 2, 0), (2, 2, 1 - 1 / math.e), (200, 2, 1), (0, 0, 0), (1e-9, 0, 1), (1, math.inf, 0)],
)
def test_onset(seconds: float, tau: float, mu: float) -> None:
    assert learning_onset(seconds, tau) == pytest.approx(mu)
