"""First-order temporal filters and the recent maximum, as pure steps and as modules with explicit state."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import (
    check_alike,
    check_dense,
    check_fits,
    check_number,
    check_state,
    check_tensor,
    is_finite,
    is_number,
)
from ndtorch.errors import InputError


def smoothing_factor(tau: float, dt: float, name: str = "tau") -> float:
    """Share of the new sample that a first-order low-pass takes in, `a = dt / (tau + dt)`.

    This is the backward Euler form, so every `tau >= 0` is stable: `tau = 0` lets the input through
    unchanged and `tau = inf` never moves away from the first sample. [A Methods; B §2.2]

    Args:
        tau: time constant in seconds, 0 to inf.
        dt: time step in seconds, > 0.
        name: of the time constant, for messages.

    Raises:
        InputError: if `tau` is negative or NaN, or `dt` is not a positive finite number.

    >>> smoothing_factor(tau=0.75, dt=0.25)
    0.25
    """
    if not (is_finite(dt) and dt > 0):
        raise InputError(f"dt must be a positive number of seconds, got {repr(dt)[:40]}")
    if not (is_number(tau) and tau >= 0):
        raise InputError(f"{name} must be >= 0 seconds, got {repr(tau)[:40]}")
    return dt / (tau + dt)


def low_pass_step(x: Tensor, low: Tensor, a: float) -> Tensor:
    """One step of a first-order low-pass, `low + a (x - low)`; the shapes broadcast."""
    return torch.lerp(low, x, a)


class FilterState(NamedTuple):
    """State of a first-order filter: its low-passed value, one sample `[..., *sample]`."""

    low: Tensor


class LowPass(nn.Module):
    """First-order low-pass over time, `l += a (x - l)` with `a = dt / (tau + dt)`.

    Shapes:
        x `[..., T, *sample]`, where `sample` has `sample_dims` dimensions: 3 for frames (C, H, W), 1 for
        signals (N). Output as x. State `[..., *sample]`; `None` settles the filter on the first sample.

    Raises:
        InputError: time constants out of range, or x that is not a dense floating point tensor of finite numbers with
            at least `sample_dims + 1` dimensions.

    >>> smooth, state = LowPass(tau=1.0, dt=0.5, sample_dims=0)(torch.tensor([0.0, 1.0, 1.0]))
    >>> smooth
    tensor([0.0000, 0.3333, 0.5556])
    """

    def __init__(self, tau: float, dt: float, sample_dims: int = 3) -> None:
        super().__init__()
        check_number("sample_dims", sample_dims, least=0, whole=True)
        self.a = smoothing_factor(tau, dt)
        self.tau, self.dt, self.sample_dims = tau, dt, sample_dims

    def extra_repr(self) -> str:
        return f"tau={self.tau}, dt={self.dt}, sample_dims={self.sample_dims}"

    def forward(self, x: Tensor, state: FilterState | None = None) -> tuple[Tensor, FilterState]:
        check_state(state, FilterState)
        dim = time_dim(x, self.sample_dims)
        check_tensor("x", x)
        samples = x.unbind(dim)
        low = samples[0] if state is None else state.low
        if samples:
            check_fits("state.low", low, samples[0])
        if self.a == 1.0:
            return x, FilterState(samples[-1] if samples else low)
        out = []
        for sample in samples:
            low = low_pass_step(sample, low, self.a)
            out.append(low)
        # One sample needs no copy.
        return low.unsqueeze(dim) if len(out) == 1 else torch.stack(out, dim), FilterState(low)


class HighPass(nn.Module):
    """First-order high-pass over time: what the low-pass of the same `tau` leaves, `x - l`.

    A constant input gives exactly zero. Shapes, state and errors as `LowPass`.

    >>> change, state = HighPass(tau=1.0, dt=0.5, sample_dims=0)(torch.tensor([0.0, 1.0, 1.0]))
    >>> change
    tensor([0.0000, 0.6667, 0.4444])
    """

    def __init__(self, tau: float, dt: float, sample_dims: int = 3) -> None:
        super().__init__()
        self.low_pass = LowPass(tau, dt, sample_dims)

    def forward(self, x: Tensor, state: FilterState | None = None) -> tuple[Tensor, FilterState]:
        low, state = self.low_pass(x, state)
        return x - low, state


class RecentMaxState(NamedTuple):
    """State of `RecentMax`: the last `window - 1` samples, `[..., window - 1, N]`, oldest first."""

    history: Tensor


class RecentMax(nn.Module):
    """Largest value of each signal over the last `seconds`, the present sample included. [B §2.1.4]

    Shapes:
        x `[..., T, N]` -> `[..., T, N]`. `state=None` behaves as if the first sample had been there for ever.

    >>> largest, state = RecentMax(seconds=2.0, dt=1.0)(torch.tensor([[3.0], [1.0], [0.0], [0.0]]))
    >>> largest.flatten()
    tensor([3., 3., 1., 0.])
    """

    def __init__(self, seconds: float, dt: float) -> None:
        super().__init__()
        if not (is_finite(dt) and dt > 0 and is_finite(seconds) and seconds >= 0):
            raise InputError(f"seconds must be >= 0 and dt > 0, got seconds={seconds}, dt={dt}")
        self.window = max(1, round(seconds / dt))

    def forward(self, x: Tensor, state: RecentMaxState | None = None) -> tuple[Tensor, RecentMaxState]:
        check_state(state, RecentMaxState)
        time_dim(x, 1)
        check_tensor("x", x)
        length = self.window - 1
        if state is None:
            state = RecentMaxState(x[..., :1, :].expand(*x.shape[:-2], length, x.shape[-1]))
        elif length and x.shape[-2]:
            check_alike("the last sample of state.history", state.history[..., -1, :], x[..., 0, :])
        samples = torch.cat([state.history, x], dim=-2)
        # A view of every window, then one reduction: no loop over time and no copy of the windows.
        largest = samples.unfold(-2, self.window, 1).amax(-1)
        return largest, RecentMaxState(samples[..., samples.shape[-2] - length :, :])


def time_dim(x: Tensor, sample_dims: int, name: str = "x") -> int:
    """Index of the time dimension, counted from the front; raises `InputError` when there is none."""
    check_dense(name, x)
    if x.ndim < sample_dims + 1:
        names = {1: "[..., T, N]", 3: "[..., T, C, H, W]"}.get(sample_dims, f"{sample_dims + 1} dims or more")
        raise InputError(f"{name} must be a tensor of shape {names}, got {tuple(x.shape)}")
    if x.shape[x.ndim - sample_dims - 1] == 0:
        raise InputError(f"{name} must hold at least one time step, got shape {tuple(x.shape)}")
    return x.ndim - sample_dims - 1
