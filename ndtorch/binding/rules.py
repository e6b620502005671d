"""Learning rules and their activation functions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_number, is_number
from ndtorch.binding.spectrum import limit_spectral_radius
from ndtorch.errors import InputError, did_you_mean
from ndtorch.vision.temporal import not_negative

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


BOOST, TAU_BOOST, TAU_ONSET = 15.0, 4.0, 0.2
"""The scale-free rule: factor by which it learns faster at first, time constant of that and of its soft start, s."""
EXPONENT, SMALLEST, BOUNDS = 4.0, 0.02, (-0.4, 1.2)
"""Exponent p of its gate, smallest deviation s as a ratio of the largest, and bounds of its weights."""
LARGEST = 10.0
"""Largest single weight where the spectral radius is limited, ten times what is learned from any scene of the papers.

Nearly triangular weights have a small spectral radius however large they are: it does not bound them.
"""


class Rule(Protocol):
    """What a learning rule is: `dW/dt = rate(t) change(...)`, off the diagonal, and W kept within its bounds.

    Attributes:
        name: what to call it.
        uses_power: whether `change` looks at the power of the outputs' fluctuations; without, none is kept.
        learns: False for a rate of zero: the weights are fixed.
    """

    @property
    def name(self) -> str: ...

    @property
    def uses_power(self) -> bool: ...

    @property
    def learns(self) -> bool: ...

    def rate(self, seconds: Tensor) -> Tensor:
        """Learning rate, 1/s, at `seconds` (float64, any shape) since learning began; 0 where they are not positive."""

    def change(self, high: Tensor, power: Tensor, weights: Tensor, steps: int = 1) -> Tensor:
        """The change of every weight, `[..., N, N]`, row: the inhibited neuron; the diagonal does not matter.

        Args:
            high: fluctuations o' of the outputs in some time steps, and in all fields that share the weights,
                `[..., S, N]`: the change is the mean over time steps of the sum over fields.
            power: running mean of o'^2, summed over fields, `[..., N]`.
            weights: `[..., N, N]`.
            steps: time steps in `high`.
        """

    def bounded(self, weights: Tensor) -> tuple[Tensor, Tensor | None]:
        """Weights within their bounds, and which networks had to be held back, `[...]` bool; None for none of them."""


class RatedRule:
    """What the rules here share: a learning rate with a soft start, and a limit on the spectral radius."""

    gamma: float | Tensor
    tau_onset: float
    radius_limit: float

    def __post_init__(self) -> None:
        for name in ("gamma", "leak"):
            rate = getattr(self, name, 0.0)
            rates = torch.as_tensor(rate) if is_number(rate) or isinstance(rate, Tensor) else torch.tensor(math.nan)
            if not (rates >= 0).all() or not torch.isfinite(rates).all():
                raise InputError(f"{name} must be a learning rate >= 0, got {repr(rate)[:80]}")
        check_number("tau_onset", self.tau_onset, least=0, unit="seconds")
        if not (is_number(self.radius_limit) and self.radius_limit > 0):
            raise InputError(f"radius_limit must be positive, got {repr(self.radius_limit)[:40]}")

    @property
    def learns(self) -> bool:
        """Whether the weights change; a rate that is a parameter may grow."""
        return isinstance(self.gamma, nn.Parameter) or bool(torch.as_tensor(self.gamma).any())

    def rate(self, seconds: Tensor) -> Tensor:
        """`gamma mu(t)`, 1/s; a negative gamma counts as 0 and keeps its gradient."""
        gamma = not_negative(torch.as_tensor(self.gamma, device=seconds.device))
        return gamma * learning_onset(seconds, self.tau_onset)

    def within_radius(self, weights: Tensor) -> tuple[Tensor, Tensor | None]:
        """Non-negative weights scaled back where their spectral radius exceeds the limit, and which of the batch
        were."""
        if math.isinf(self.radius_limit):
            return weights, None
        limited = limit_spectral_radius(weights, self.radius_limit)
        # The limit returns the very same tensor where all weights were inside it.
        return limited, None if limited is weights else (limited != weights).any(-1).any(-1)


@dataclass(frozen=True, eq=False)
class LearningRule(RatedRule):
    """`dW[n, k]/dt = gamma mu(t) a(o'_n) b(o'_k)`, n != k, W not negative. [B eq. 23-24, C §2.3]

    Attributes:
        row: a, applied to the inhibited neuron n.
        column: b, applied to the inhibiting neuron k.
        name: what to call the rule.
        gamma: learning rate, 1/s; a tensor `[...]` gives every network of a batch its own; a `torch.nn.Parameter` is
            learned and is in the `parameters()` of the network. 0: fixed weights.
        tau_onset: soft start of learning, seconds; `mu = 1 - exp(-t / tau_onset)`.
        radius_limit: largest spectral radius of the weights; `inf` leaves stability to fate.

    An expansive b favours columns: every neuron *competes* to silence the others, which suits fewer sources
    than neurons. An expansive a favours rows: the neurons *cooperate* to subtract one another. [C §5.3.5]

    Raises:
        InputError: gamma, tau_onset or radius_limit out of range.
    """

    row: Activation
    column: Activation
    name: str = "custom"
    gamma: float | Tensor = 0.5
    tau_onset: float = 2.0
    radius_limit: float = 0.95

    uses_power = False

    def change(self, high: Tensor, power: Tensor, weights: Tensor, steps: int = 1) -> Tensor:
        """Products `a(o'_n) b(o'_k)` of the outputs' fluctuations, `[..., S, N]` -> `[..., N, N]`."""
        row, column = self.row(high).mT, self.column(high)
        if high.shape[-2] == 1:
            return row * column
        return row @ column / steps

    def bounded(self, weights: Tensor) -> tuple[Tensor, Tensor | None]:
        """Negative weights become zero, single ones at most `LARGEST`; too large a spectral radius is scaled back."""
        positive = weights.clamp_min(0) if math.isinf(self.radius_limit) else weights.clamp_min(0).clamp_max(LARGEST)
        return self.within_radius(positive)


@dataclass(frozen=True)
class ScaleFreeRule(RatedRule):
    """`dT[n, k]/dt = gamma(t) mu(t) (c <o'_n o'_k> / s_k^2 - leak (1 - c) T[n, k])`, `c = s_k^p / (s_k^p + s_n^p)`.

    The gate is c, s the deviation of an output. Both terms keep their value when all signals are multiplied by a
    constant, hence the name: weak signals learn as fast as strong ones.

    **Fixed points**, with `r = <o'_n o'_k> / s_k^2`: `T[n, k] = c r / (leak (1 - c))`. Where k is much stronger than n
    the gate is 1, and only r = 0 will do: the weaker output is free of the stronger one. Where it is much weaker, only
    T = 0. So T is triangular in the order of the outputs' strength, and all outputs are uncorrelated: owner 1 keeps
    what it receives, owner 2 its input less what goes along with owner 1, and so on (a Cholesky factor of the
    covariance). Two outputs of equal strength share, `T = r / leak` both ways.

    **Stability**, with settled feedback: from `(I + T) o = y`, `d o_n / dT[n, k] = -o_k / (1 - T[n, k] T[k, n])` for
    two neurons, so the bracket falls with T[n, k] at the rate `c / (1 - T[n, k] T[k, n]) + leak (1 - c)`, positive
    while the loop stays below 1, as the limit on the Perron root ensures. Perturbations die out within `1 / gamma`.

    Attributes:
        gamma: learning rate in the long run, 1/s.
        leak: how fast weights from the weaker to the stronger are forgotten, against `gamma`.
        radius_limit: of the Perron root of the weights' magnitudes.

    Raises:
        InputError: a constant out of range.
    """

    gamma: float | Tensor = 0.2
    leak: float | Tensor = 2.0
    radius_limit: float = 0.95

    name = "scale-free"
    uses_power = True
    tau_onset = TAU_ONSET

    def rate(self, seconds: Tensor) -> Tensor:
        """`gamma(t) mu(t)`, 1/s."""
        return super().rate(seconds) * (1 + BOOST * torch.exp(-seconds / TAU_BOOST))

    def change(self, high: Tensor, power: Tensor, weights: Tensor, steps: int = 1) -> Tensor:
        """The bracket of the rule, `[..., N, N]`."""
        largest = power.amax(-1, keepdim=True).clamp_min(torch.finfo(power.dtype).tiny)
        relative = (power / largest).clamp_min(SMALLEST**2)
        strength = relative ** (EXPONENT / 2)
        sender, receiver = strength.unsqueeze(-2), strength.unsqueeze(-1)
        gate = sender / (sender + receiver)
        correlation = high.mT @ high / (steps * relative * largest).unsqueeze(-2)
        leak = not_negative(self.leak) if isinstance(self.leak, Tensor) else self.leak
        return gate * correlation - leak * (1 - gate) * weights

    def bounded(self, weights: Tensor) -> tuple[Tensor, Tensor | None]:
        """Weights within their bounds, and the Perron root of their magnitudes within its limit."""
        clipped = weights.clamp(*BOUNDS)
        limited, full = self.within_radius(clipped.abs())
        return clipped if full is None else torch.copysign(limited, clipped), full


def learning_onset(seconds: Tensor, tau: float) -> Tensor:
    """Soft start `mu = 1 - exp(-t / tau)` at `seconds` since learning began, 0 before. [B eq. 24]

    `tau = 0` switches learning on at once.
    """
    if tau == 0:
        return (seconds > 0).to(seconds.dtype)
    return -torch.expm1(seconds.clamp_min(0) / -tau)


def _of_two(name: str, f: str = "cube", g: str = "tanh-pi", **constants: Any) -> LearningRule:
    for role, own in (("f", f), ("g", g)):
        if own not in ACTIVATIONS:
            hint = did_you_mean(own, ACTIVATIONS)
            raise InputError(f"{role} must be one of {', '.join(ACTIVATIONS)}, got {own!r}{hint}")
    expansive, compressive = ACTIVATIONS[f], ACTIVATIONS[g]
    row, column = {
        "competitive": (compressive, expansive),
        "cooperative": (expansive, compressive),
        "hebbian": (linear, linear),
    }[name]
    return LearningRule(row, column, name, **constants)


RULES: dict[str, Callable[..., Rule]] = {
    **{name: partial(_of_two, name) for name in ("competitive", "cooperative", "hebbian")},
    "scale-free": ScaleFreeRule,
}
"""Makers of the rules, by name, to which everybody can add:
`RULES["sign"] = lambda f="", g="", **constants: LearningRule(torch.sign, cube, "sign", **constants)`. Models pass the
`f` and `g` of their config."""


def learning_rule(name: str, **constants: Any) -> Rule:
    """The rule of that name, with constants of its own.

    competitive: compressive g on the row, expansive f on the column; cooperative: the reverse; hebbian: both
    linear. These three take `f` and `g` (names of `ACTIVATIONS`), `gamma`, `tau_onset` and `radius_limit`. scale-free
    takes the attributes of `ScaleFreeRule`.

    Raises:
        InputError: unknown name of a rule, of a function or of a constant, or a constant out of range.

    >>> learning_rule('competitive', gamma=2.0).gamma
    2.0
    """
    if name not in RULES:
        raise InputError(f"rule must be one of {', '.join(RULES)}, got {name!r}{did_you_mean(name, RULES)}")
    try:
        return RULES[name](**constants)
    except TypeError as error:
        raise InputError(f"rule {name}: {error}") from None
