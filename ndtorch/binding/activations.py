"""Functions of the outputs that learning rules are made of, by name."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor

from ndtorch.errors import InputError, did_you_mean

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


def activation(role: str, name: str) -> Activation:
    """The function of that name; `InputError` names the role it was to play."""
    if name not in ACTIVATIONS:
        raise InputError(
            f"{role} must be one of {', '.join(ACTIVATIONS)}, got {name!r}{did_you_mean(name, ACTIVATIONS)}"
        )
    return ACTIVATIONS[name]
