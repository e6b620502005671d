"""One scale-free network shared by all fields: what fluctuates together, here and now, belongs together."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.binding.normalise import group_max, spread_groups
from ndtorch.binding.scale_free import ScaleFreeRule, settled
from ndtorch.errors import InputError
from ndtorch.vision.temporal import low_pass_step, smoothing_factor

# Mean square of the outputs' fluctuations in the liveliest field under which nothing is going on.
FAINT = 0.05**2


class FieldBindingState(NamedTuple):
    """Everything that changes.

    Attributes:
        scale: recent maximum of each group over all fields, `[3]`.
        weights: T, `[10, 10]`.
        low: what the high-pass of the outputs has taken for the mean, `[F, 10]`.
        power: running mean of o'^2, summed over fields, `[10]`.
        share: how much of that mean has been seen, `[]`.
        learned: seconds of learning, `[]` float64.
    """

    scale: Tensor
    weights: Tensor
    low: Tensor
    power: Tensor
    share: Tensor
    learned: Tensor


class FieldBinding(nn.Module):
    """`o_f = (I + T)^-1 y_f` in every field f, with one T learned from all of them by the scale-free rule.

    In ordinary video things pass once instead of fluctuating. But where a thing is, all of its features are, and
    elsewhere none: over fields and time together they fluctuate in common even in a single pass. The rule takes the
    products `o'_n o'_k` summed over fields. Its clock stands still while nothing happens, so that it neither forgets
    in quiet times nor learns from noise.

    Signals are divided by the largest of their group in any field in the last `memory` seconds (an exponential
    decay), but by `floor` at least.

    Args:
        dt: seconds between time steps.
        rule: the learning rule.
        memory: of the group maxima, seconds.
        floor: smallest divisor, in the signals' units: compressed contrast.
        tau_out, tau_power: high-pass of the outputs and memory of their power, seconds.
        learn: False keeps T at zero (what the network is worth: compare).

    Shapes:
        signals `[T, F, 10]`, not negative -> (inputs y, outputs o), both `[T, F, 10]`, and the state; `None` starts
        with nothing learned.
    """

    def __init__(
        self,
        dt: float,
        rule: ScaleFreeRule | None = None,
        memory: float = 20.0,
        floor: float = 0.02,
        tau_out: float = 2.0,
        tau_power: float = 3.0,
        learn: bool = True,
    ) -> None:
        super().__init__()
        self.rule = rule or ScaleFreeRule()
        self.dt, self.floor, self.learn = dt, floor, learn
        self.keep = math.exp(-dt / memory)
        self.a_out, self.a_power = smoothing_factor(tau_out, dt), smoothing_factor(tau_power, dt)

    def start(self, first: Tensor) -> FieldBindingState:
        """State at rest for signals like `first`, `[F, 10]`."""
        zero = first.new_zeros(10)
        return FieldBindingState(
            first.new_zeros(3),
            first.new_zeros(10, 10),
            torch.zeros_like(first),
            zero,
            first.new_zeros(()),
            torch.zeros((), dtype=torch.float64),
        )

    def forward(
        self, signals: Tensor, state: FieldBindingState | None = None
    ) -> tuple[tuple[Tensor, Tensor], FieldBindingState]:
        if signals.ndim != 3 or signals.shape[-1] != 10:
            raise InputError(f"signals must be [T, F, 10], got {tuple(signals.shape)}")
        if len(signals) == 0 and state is None:
            raise InputError("signals must hold at least one time step to start from")
        state = self.start(signals[0]) if state is None else state
        inputs, outputs = [], []
        for sample in signals:
            scale = torch.maximum(self.keep * state.scale, group_max(sample).amax(0))
            y = sample / spread_groups(scale.clamp_min(self.floor))
            o = y @ settled(state.weights).mT
            low = low_pass_step(o, state.low, self.a_out)
            state = self._learned(o - low, state._replace(scale=scale, low=low))
            inputs.append(y)
            outputs.append(o)
        return (torch.stack(inputs), torch.stack(outputs)) if inputs else (signals, signals), state

    def _learned(self, high: Tensor, state: FieldBindingState) -> FieldBindingState:
        """The state after one step of learning from the outputs' fluctuations, `[F, 10]`."""
        squares = high.square()
        if not self.learn or float(squares.mean(-1).max()) < FAINT:
            return state
        power = low_pass_step(squares.sum(0), state.power, self.a_power)
        share = state.share + self.a_power * (1 - state.share)
        learned = state.learned + self.dt
        rate = self.rule.rate(float(learned))
        change = self.rule.change(high.mT @ high, power / share, state.weights)
        weights = self.rule.bounded(state.weights + rate * self.dt * change)
        return state._replace(power=power, share=share, learned=learned, weights=weights)
