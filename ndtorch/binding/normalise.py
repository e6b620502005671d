"""From ten spatial sums to the inputs of the binding networks: high-pass and group normalisation."""

from __future__ import annotations

from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_number
from ndtorch.errors import InputError
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.features import GROUPS
from ndtorch.vision.temporal import FilterState, HighPass, RecentMaxState, RunningMax, check_series

Order = Literal["filter-first", "printed"]
ORDERS: tuple[Order, ...] = ("filter-first", "printed")


SIZES = [group.stop - group.start for group in GROUPS.values()]
"""Features of each group."""


@safe_state
class InputState(NamedTuple):
    """State of `BindingInputs`: the high-pass `[..., 10]` and recent group maxima `[..., W - 1, 3]`."""

    low: Tensor
    sums: Tensor
    fluctuations: Tensor


class BindingInputs(nn.Module):
    """High-pass the ten sums and divide each group by its recent maximum. [B §2.1.4, §2.2]

    "filter-first" (default) high-passes the sums and divides by the largest filtered magnitude of the group in
    the last two seconds; "printed" divides by the largest raw value of the group first and filters second, as
    the text of [B] says. Only the first order reproduces the published weights: dividing the raw sums by their
    own maximum first leaves fluctuations so weak that the cubic rule hardly learns (largest weight 0.03
    instead of 0.85).

    A group whose fluctuations stay below `floor` of its raw recent maximum is divided by that instead, so that
    the noise of a static scene is not blown up to full scale.

    Args:
        dt: time step in seconds.
        order: "filter-first" or "printed".
        tau: time constant of the high-pass, seconds.
        window: seconds of the recent maximum.
        floor: smallest fluctuation, as a share of the group's raw recent maximum, that counts as full scale.

    Shapes:
        sums `[..., T, 10]` -> (inputs `[..., T, 10]`, scale `[..., T, 10]`), state. `scale` is each group's raw
        recent maximum M(t), the n(t) of [C eq. 11]. `None` settles on the first sample.

    >>> (signals, scale), state = BindingInputs()(torch.rand(20, 10))
    >>> signals.shape
    torch.Size([20, 10])
    """

    def __init__(
        self,
        dt: float = 0.01,
        order: Order = "filter-first",
        tau: float = 1.0,
        window: float = 2.0,
        floor: float = 0.01,
    ) -> None:
        super().__init__()
        if order not in ORDERS:
            raise InputError(f"order must be one of {', '.join(ORDERS)}, got {order!r}")
        check_number("floor", floor, least=0)
        check_number("window", window, least=0, unit="seconds")
        self.order, self.floor = order, floor
        self.high_pass = HighPass(tau, dt, sample_dims=1)
        self.recent_max = RunningMax(window, dt)

    def forward(self, sums: Tensor, state: InputState | None = None) -> tuple[tuple[Tensor, Tensor], InputState]:
        check_series(sums, 1, state, InputState, "sums")
        if sums.shape[-1] != 10:
            raise InputError(f"sums must be [..., T, 10], got {tuple(sums.shape)}")
        return self.scan(sums, state)

    def scan(self, sums: Tensor, state: InputState | None) -> tuple[tuple[Tensor, Tensor], InputState]:
        """`forward` without checks, for modules that have checked the sums."""
        low = raw_history = filtered_history = None
        if state is not None:
            low = FilterState(state.low)
            raw_history, filtered_history = RecentMaxState(state.sums), RecentMaxState(state.fluctuations)
        raw_max, raw_history = self.recent_max.scan(group_max(sums), raw_history)
        scale = spread_groups(raw_max)
        printed = self.order == "printed"
        inputs, low = self.high_pass.scan(divide(sums, scale) if printed else sums, low)
        size = (inputs * scale if printed else inputs).abs()
        largest, filtered_history = self.recent_max.scan(group_max(size), filtered_history)
        if not printed:
            inputs = divide(inputs, spread_groups(torch.maximum(largest, self.floor * raw_max)))
        end = InputState(low.low, raw_history.history, filtered_history.history)
        return (inputs, scale), end


def group_max(signals: Tensor) -> Tensor:
    """Largest signal of each group, `[..., 10]` -> `[..., 3]`."""
    motion, orientation, color = torch.split(signals, SIZES, -1)
    return torch.stack((motion.amax(-1), orientation.amax(-1), color.amax(-1)), -1)


def spread_groups(values: Tensor) -> Tensor:
    """One value a group to one value a feature, `[..., 3]` -> `[..., 10]`."""
    motion, orientation, color = values.unsqueeze(-1).expand(*values.shape, max(SIZES)).unbind(-2)
    return torch.cat((motion[..., : SIZES[0]], orientation[..., : SIZES[1]], color[..., : SIZES[2]]), -1)


def divide(signals: Tensor, divisor: Tensor) -> Tensor:
    """Quotient, and zero where the divisor is zero: a group that was silent stays silent. [B eq. 17]"""
    silent = divisor == 0
    return torch.where(silent, torch.zeros_like(signals), signals / torch.where(silent, 1.0, divisor))
