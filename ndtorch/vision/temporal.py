"""Filters over time: low- and high-pass, running maximum, change of the sampling rate."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, overload

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_number, check_state, check_tensor, has_values, is_finite, is_number
from ndtorch.errors import InputError
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.frames import fresh

MOST_ROWS = 100_000
"""Time steps of the longest memory of single numbers."""


def safe_sqrt(x: Tensor) -> Tensor:
    """Square root of what is positive, 0 elsewhere; there its gradient is 0, not infinite.

    What is zero because nothing is seen stays so whatever is changed a little, and an infinite slope times the zero
    slope of that would be no number.
    """
    positive = x > 0
    return x.where(positive, 1.0).sqrt().where(positive, 0.0)


Seconds = float | Tensor
"""A time constant or a time step: a number that is fixed, or a tensor that gradients can reach."""

Discretization = Literal["euler", "exact"]
"""How a filter's time constant becomes its share of a new sample, see `smoothing_factor`."""


@overload
def smoothing_factor(tau: float, dt: float, name: str = "tau", discretization: Discretization = "euler") -> float: ...


@overload
def smoothing_factor(
    tau: Seconds, dt: Seconds, name: str = "tau", discretization: Discretization = "euler"
) -> float | Tensor: ...


def smoothing_factor(
    tau: Seconds, dt: Seconds, name: str = "tau", discretization: Discretization = "euler"
) -> float | Tensor:
    """Share of the new sample that a first-order low-pass takes in, `a = dt / (tau + dt)`.

    This is the backward Euler form, so every `tau >= 0` is stable: `tau = 0` lets the input through
    unchanged and `tau = inf` never moves away from the first sample. [A Methods; B §2.2] It is slower than its time
    constant, the more the fewer samples there are in one; "exact", `a = 1 - exp(-dt / tau)`, decays as the continuous
    filter does.

    Args:
        tau: time constant in seconds, 0 to inf; of a tensor what is negative counts as 0, and its gradient is that
            at 0.
        dt: time step in seconds, > 0.
        name: of the time constant, for messages.
        discretization: "euler" or "exact"; with "exact" a tensor `tau` counts as dt / 10 at least, which gives
            a share of .99995 and still a gradient.

    Raises:
        InputError: if `tau` is negative or NaN, or `dt` is not a positive finite number.

    >>> smoothing_factor(tau=0.75, dt=0.25)
    0.25
    """
    if isinstance(dt, Tensor):
        check_tensor("dt", dt, meta=True)
    elif not (is_finite(dt) and dt > 0):
        raise InputError(f"dt must be a positive number of seconds, got {repr(dt)[:40]}")
    if isinstance(tau, Tensor):
        check_tensor(name, tau, meta=True)
    elif not (is_number(tau) and tau >= 0):
        raise InputError(f"{name} must be >= 0 seconds, got {repr(tau)[:40]}")
    if discretization not in ("euler", "exact"):
        raise InputError(f"discretization must be euler or exact, got {discretization!r}")
    return ratio(tau, dt, discretization)


def not_negative(x: Tensor) -> Tensor:
    """Negative values as 0, with the gradient of the value itself: an optimiser that stepped below 0 finds back."""
    return x + (x.clamp_min(0) - x).detach()


def ratio(tau: Seconds, dt: Seconds, discretization: Discretization = "euler") -> float | Tensor:
    """`smoothing_factor` of numbers that were checked."""
    if discretization == "exact":
        if isinstance(tau, Tensor):  # below dt / 10 the gradient is nothing
            return -torch.expm1(-dt / (tau + (tau.clamp(min=dt / 10) - tau).detach()))
        if tau == 0:
            return 1.0
        return -torch.expm1(-dt / tau) if isinstance(dt, Tensor) else -math.expm1(-dt / tau)
    return dt / ((not_negative(tau) if isinstance(tau, Tensor) else tau) + dt)


def keep_time(module: nn.Module, discretization: Discretization = "euler", **seconds: Seconds) -> None:
    """Set time constants and `dt` as attributes of a module: parameters stay parameters, other tensors are buffers."""
    module.discretization = discretization  # type: ignore[assignment]
    for name, value in seconds.items():
        smoothing_factor(value, seconds["dt"], name, discretization)
        if isinstance(value, Tensor) and not isinstance(value, nn.Parameter):
            module.register_buffer(name, value)
        else:
            setattr(module, name, value)


def low_pass_step(x: Tensor, low: Tensor, a: float | Tensor) -> Tensor:
    """One step of a first-order low-pass, `low + a (x - low)`; the shapes broadcast."""
    return torch.lerp(low, x, a.to(x.dtype) if isinstance(a, Tensor) else a)


BLOCK = 64
"""Samples that a filter takes by one product of matrices, where it is compiled, exported or on a GPU."""


def low_pass(
    x: Tensor,
    low: Tensor | None,
    tau: Seconds,
    dt: Seconds,
    dim: int,
    discretization: Discretization = "euler",
    blocks: bool = True,
    high: bool = False,
) -> tuple[Tensor, Tensor]:
    """Low-passed samples like `x`, along `dim`, and the last of them; the state `low` defaults to the first sample.
    With `high` what the low-pass leaves, in place of what it lets through.

    On a CPU a loop over time moves the fewest bytes. What is compiled or exported, or on a GPU, is done in blocks: the
    number of operations does not grow with time. Networks, which are loops over time anyway, ask for no blocks.
    """
    a = ratio(tau, dt, discretization)
    if isinstance(a, Tensor):
        a = a.to(x.dtype)
    low = x.select(dim, 0) if low is None else low
    out: list[Tensor] = []
    several = x.shape[dim] > 1 and not (isinstance(a, Tensor) and a.ndim)
    # Under autocast a product of matrices would be one of half precision.
    blocks = blocks and several and not torch.is_autocast_enabled("cuda" if x.is_cuda else "cpu")
    if blocks and (torch.compiler.is_compiling() or x.is_cuda):
        for block in torch.split(x, BLOCK, dim):
            out.append(low_pass_block(block, low, a, dim))
            low = out[-1].select(dim, -1)
        lows = out[0] if len(out) == 1 else torch.cat(out, dim)
    elif several and not torch.is_grad_enabled() and low.shape == x.select(dim, 0).shape and has_values(x, low):
        passed = fresh(x.shape, x)
        for sample, place in zip(x.unbind(dim), passed.unbind(dim), strict=True):
            low = torch.lerp(low, sample, a, out=None if high else place)
            if high:
                torch.sub(sample, low, out=place)
        return passed, low.clone()
    else:
        for sample in x.unbind(dim):
            low = torch.lerp(low, sample, a)
            out.append(low)
        lows = low.unsqueeze(dim) if len(out) == 1 else torch.stack(out, dim)
    return x - lows if high else lows, low


def low_pass_block(x: Tensor, low: Tensor, a: float | Tensor, dim: int) -> Tensor:
    """`low_pass` by one product: `l[t] = l + sum_s<=t a (1 - a)^(t - s) (x[s] - l)` with the state l before."""
    time = torch.arange(x.shape[dim], device=x.device, dtype=x.dtype)
    weights = (a * (1 - a) ** (time[:, None] - time).clamp_min(0)).tril()
    change: Tensor = torch.tensordot(weights, x - low.unsqueeze(dim), ([1], [dim])).movedim(0, dim)
    return low.unsqueeze(dim) + change


@safe_state
class FilterState(NamedTuple):
    """State of a first-order filter: its low-passed value, one sample `[..., *sample]`."""

    low: Tensor


class LowPass(nn.Module):
    """First-order low-pass over time, `l += a (x - l)` with `a` of `smoothing_factor`.

    Shapes:
        x `[..., T, *sample]`, where `sample` has `sample_dims` dimensions: 3 for frames (C, H, W), 1 for
        signals (N). Output as x. State `[..., *sample]`; `None` settles the filter on the first sample.

    Args:
        tau: time constant in seconds, 0 to inf; a number, or a tensor that broadcasts against a sample. A
            `torch.nn.Parameter` is learned: it is in `parameters()`.
        dt: time step in seconds, a number or a tensor.
        discretization: "euler", as published, or "exact".

    Raises:
        InputError: time constants out of range, or x that is not a dense floating point tensor of finite numbers with
            at least `sample_dims + 1` dimensions.

    >>> smooth, state = LowPass(tau=1.0, dt=0.5, sample_dims=0)(torch.tensor([0.0, 1.0, 1.0]))
    >>> smooth
    tensor([0.0000, 0.3333, 0.5556])
    """

    tau: Seconds
    dt: Seconds
    discretization: Discretization

    def __init__(
        self, tau: Seconds, dt: Seconds, sample_dims: int = 3, discretization: Discretization = "euler"
    ) -> None:
        super().__init__()
        check_number("sample_dims", sample_dims, least=0, whole=True)
        keep_time(self, discretization, tau=tau, dt=dt)
        self.sample_dims = sample_dims

    def forward(self, x: Tensor, state: FilterState | None = None) -> tuple[Tensor, FilterState]:
        check_series(x, self.sample_dims, state, FilterState)
        return self.scan(x, state)

    def scan(self, x: Tensor, state: FilterState | None) -> tuple[Tensor, FilterState]:
        """`forward` without checks, for modules that have checked x."""
        lows, low = low_pass(x, state and state.low, self.tau, self.dt, -1 - self.sample_dims, self.discretization)
        return lows, FilterState(low)


class HighPass(LowPass):
    """First-order high-pass over time: what the low-pass of the same `tau` leaves, `x - l`.

    A constant input gives exactly zero. Shapes, state and errors as `LowPass`.

    >>> change, state = HighPass(tau=1.0, dt=0.5, sample_dims=0)(torch.tensor([0.0, 1.0, 1.0]))
    >>> change
    tensor([0.0000, 0.6667, 0.4444])
    """

    def scan(self, x: Tensor, state: FilterState | None) -> tuple[Tensor, FilterState]:
        low, dim = state and state.low, -1 - self.sample_dims
        change, low = low_pass(x, low, self.tau, self.dt, dim, self.discretization, high=True)
        return change, FilterState(low)


@safe_state
class RecentMaxState(NamedTuple):
    """State of `RunningMax`: the last `window - 1` samples, `[..., window - 1, N]`, oldest first."""

    history: Tensor


class RunningMax(nn.Module):
    """Largest value of each signal over the last `seconds`, the present sample included. [B §2.1.4]

    Shapes:
        x `[..., T, N]` -> `[..., T, N]`. `state=None` behaves as if the first sample had been there for ever.

    >>> largest, state = RunningMax(seconds=2.0, dt=1.0)(torch.tensor([[3.0], [1.0], [0.0], [0.0]]))
    >>> largest.flatten()
    tensor([3., 3., 1., 0.])
    """

    def __init__(self, seconds: float, dt: float) -> None:
        super().__init__()
        if not (is_finite(dt) and dt > 0 and is_finite(seconds) and seconds >= 0):
            raise InputError(f"seconds must be >= 0 and dt > 0, got seconds={seconds}, dt={dt}")
        self.seconds, self.dt = seconds, dt
        if seconds / dt > MOST_ROWS:
            raise InputError(f"seconds must be {MOST_ROWS} time steps of {dt:g} s at most, got {seconds:g} s")
        self.window = max(1, round(seconds / dt))

    def forward(self, x: Tensor, state: RecentMaxState | None = None) -> tuple[Tensor, RecentMaxState]:
        check_series(x, 1, state, RecentMaxState)
        return self.scan(x, state)

    def scan(self, x: Tensor, state: RecentMaxState | None) -> tuple[Tensor, RecentMaxState]:
        """`forward` without checks, for modules that have checked x."""
        length = self.window - 1
        if state is None:
            state = RecentMaxState(x[..., :1, :].expand(*x.shape[:-2], length, x.shape[-1]))
        samples = torch.cat([state.history, x], dim=-2)
        # A view of every window, then one reduction: no loop over time and no copy of the windows.
        largest = samples.unfold(-2, self.window, 1).amax(-1)
        return largest, RecentMaxState(samples[..., samples.shape[-2] - length :, :])


def check_series(x: Tensor, sample_dims: int, state: object = None, kind: type = object, name: str = "x") -> None:
    """Raise `InputError` unless `x` is a floating point tensor `[..., T >= 1, *sample]` of finite numbers, and `state`
    None or of a kind."""
    check_tensor(name, x, meta=True)
    check_state(state, kind)
    if x.ndim < sample_dims + 1:
        names = {1: "[..., T, N]", 3: "[..., T, C, H, W]"}.get(sample_dims, f"{sample_dims + 1} dims or more")
        raise InputError(f"{name} must be a tensor of shape {names}, got {tuple(x.shape)}")
    if x.shape[-1 - sample_dims] == 0:
        raise InputError(f"{name} must hold at least one time step, got shape {tuple(x.shape)}")


@safe_state
class ResampleState(NamedTuple):
    """Last sample `[..., N]`, samples taken and samples given so far (int64 scalars)."""

    last: Tensor
    taken: Tensor
    given: Tensor


class Resample(nn.Module):
    """Linear interpolation of signals from one time step to another.

    The networks' inhibition acts with a delay of one step, so a step as long as a frame of ordinary video
    makes them oscillate; they keep their own, and signals are interpolated between frames. Output m lies at
    time `m dt_out` and comes as soon as the inputs reach that far.

    Args:
        dt_in, dt_out: seconds between samples.

    Shapes:
        x `[..., T, N]` -> `[..., T', N]`; T' is about `T dt_in / dt_out` and can be 0. With equal steps the
        input is returned as it is.

    Raises:
        InputError: steps out of range, or x that is not a dense floating point tensor of finite numbers.

    >>> double, state = Resample(dt_in=0.04, dt_out=0.02)(torch.arange(4.0).unsqueeze(-1))
    >>> double.shape
    torch.Size([7, 1])
    """

    def __init__(self, dt_in: float, dt_out: float) -> None:
        super().__init__()
        for name, value in (("dt_in", dt_in), ("dt_out", dt_out)):
            if not (is_finite(value) and value > 0):
                raise InputError(f"{name} must be a positive number of seconds, got {repr(value)[:40]}")
        self.dt_in, self.dt_out = dt_in, dt_out
        self.ratio = dt_out / dt_in
        self.identity = math.isclose(dt_in, dt_out, rel_tol=1e-9)

    def forward(self, x: Tensor, state: ResampleState | None = None) -> tuple[Tensor, ResampleState]:
        check_series(x, 1, state, ResampleState)
        return self.scan(x, state)

    def scan(self, x: Tensor, state: ResampleState | None) -> tuple[Tensor, ResampleState]:
        """`forward` without checks, for modules that have checked x."""
        if self.identity:
            steps = torch.zeros((), dtype=torch.int64) if state is None else state.taken
            return x, ResampleState(x[..., -1, :], steps + x.shape[-2], steps + x.shape[-2])
        last, taken, given = (x[..., 0, :], 0, 0) if state is None else (state.last, int(state.taken), int(state.given))
        length = x.shape[-2]
        end = taken + length
        # A hair of slack: output times that coincide with a frame must not wait for the next one.
        upto = math.floor((end - 1) / self.ratio + 1e-6) + 1
        places = torch.arange(given, max(upto, given), dtype=torch.float64) * self.ratio - (taken - 1)
        places = places.clamp(0, length)
        left = places.floor().clamp_max(max(length - 1, 0)).long()
        share = (places - left).to(dtype=x.dtype, device=x.device).unsqueeze(-1)
        left = left.to(x.device)
        samples = torch.cat([last.unsqueeze(-2), x], -2)
        out = torch.lerp(samples.index_select(-2, left), samples.index_select(-2, left + 1), share)
        return out, ResampleState(x[..., -1, :], torch.tensor(end), torch.tensor(max(upto, given)))
