"""Learning rules of the inhibitory network: which pairs of outputs change which weight, and how."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from ndtorch.errors import InputError

Activation = Callable[[Tensor], Tensor]


def cube(x: Tensor) -> Tensor:
    """Expansive nonlinearity `x^3`. [B §2.2.2]"""
    return x * x * x


def tanh_pi(x: Tensor) -> Tensor:
    """Compressive nonlinearity `tanh(pi x)`. [B §2.2.2]"""
    return torch.tanh(x * math.pi)


def tanh_10(x: Tensor) -> Tensor:
    """Compressive nonlinearity `tanh(10 x)` of Herault and Jutten (1986)."""
    return torch.tanh(x * 10.0)


def linear(x: Tensor) -> Tensor:
    """No nonlinearity: with both functions linear, the rule is Hebb's."""
    return x


ACTIVATIONS: dict[str, Activation] = {"cube": cube, "tanh-pi": tanh_pi, "tanh-10": tanh_10, "linear": linear}
"""Functions a rule can be made of, by name."""


@dataclass(frozen=True)
class LearningRule:
    """`dW[n, k]/dt = gamma mu(t) a(o'_n) b(o'_k)`, n != k. [B eq. 23-24, C §2.3]

    Attributes:
        row: a, applied to the inhibited neuron n.
        column: b, applied to the inhibiting neuron k.
        name: what to call the rule.

    An expansive b favours columns: every neuron *competes* to silence the others, which suits fewer sources
    than neurons. An expansive a favours rows: the neurons *cooperate* to subtract one another. [C §5.3.5]
    """

    row: Activation
    column: Activation
    name: str = "custom"

    def change(self, fluctuation: Tensor) -> Tensor:
        """Products `a(o'_n) b(o'_k)` of the outputs' fluctuations, `[..., N]` -> `[..., N, N]`."""
        return self.row(fluctuation).unsqueeze(-1) * self.column(fluctuation).unsqueeze(-2)


RULE_NAMES = ("competitive", "cooperative", "hebbian")
"""Names that `learning_rule` takes. (`VisualBinding` also knows "scale-free", see `ScaleFreeRule`.)"""


def learning_rule(name: str, f: str = "cube", g: str = "tanh-pi") -> LearningRule:
    """The rule of that name, from the expansive `f` and the compressive `g`.

    competitive: g on the row, f on the column; cooperative: the other way round; hebbian: both linear.

    Raises:
        InputError: unknown name of a rule or of a function.
    """
    for role, function in (("f", f), ("g", g)):
        if function not in ACTIVATIONS:
            raise InputError(f"{role} must be one of {', '.join(ACTIVATIONS)}, got {function!r}")
    if name == "competitive":
        return LearningRule(ACTIVATIONS[g], ACTIVATIONS[f], name)
    if name == "cooperative":
        return LearningRule(ACTIVATIONS[f], ACTIVATIONS[g], name)
    if name == "hebbian":
        return LearningRule(linear, linear, name)
    raise InputError(f"rule must be one of {', '.join(RULE_NAMES)} (or scale-free, in VisualBinding), got {name!r}")


def learning_onset(seconds: float, tau: float) -> float:
    """Soft start `mu = 1 - exp(-t / tau)` at `seconds` since learning began, 0 before. [B eq. 24]

    `tau = 0` switches learning on at once.
    """
    if seconds <= 0:
        return 0.0
    return 1.0 if tau == 0 else -math.expm1(-seconds / tau)
