"""Non-directional motion sensors, and how a sensor answers images that move at known speeds. [A fig. 1, 3]"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ndtorch.arguments import check_number, check_state
from ndtorch.errors import InputError
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.frames import trial_by_trial
from ndtorch.vision.motion import correlate
from ndtorch.vision.temporal import (
    Discretization,
    FilterState,
    HighPass,
    LowPass,
    Seconds,
    check_series,
    keep_time,
    low_pass,
    ratio,
)


class NDMin(nn.Module):
    """The smallest speed sensor: a high-pass at every pixel, `HP(p_n)`. [A fig. 1c]

    Its output is signed and has zero mean; the speed of the image is in its magnitude (`spatial_maximum`).
    The raw output of an edge of contrast `c` moving one pixel a step is about `c (1 - a)` with
    `a` of `smoothing_factor`; [A fig. 3] and the thresholds of [A] are in this output x 20 (`SPEED_SCALE`).

    Shapes:
        x: rows `[..., T, 1, 1, W]` or images `[..., T, C, H, W]`, one channel at a time -> the same.
        State: one frame. `None` settles the sensor on the first frame, so a constant scene gives zero.

    Args:
        tau_high: time constant of the high-pass in seconds, 0 to inf; a number, or a tensor, which as a
            `torch.nn.Parameter` is learned.
        dt: time step in seconds, a number or a tensor.
        discretization: of the filter, "euler" or "exact", see `smoothing_factor`.

    Raises:
        InputError: time constants out of range, or x that is not a dense floating point tensor of finite numbers with
            at least four dimensions.

    >>> row = torch.zeros(5, 1, 1, 40)
    >>> row[2:, ..., 20:] = 1.0  # it becomes bright at once, and stays so
    >>> motion, state = NDMin(dt=1 / 30)(row)
    >>> (motion > 0.01).flatten(1).any(1)
    tensor([False, False,  True,  True, False])
    """

    tau_high: Seconds
    dt: Seconds
    discretization: Discretization

    def __init__(
        self, tau_high: Seconds = 0.005, dt: Seconds = 1 / 30, *, discretization: Discretization = "euler"
    ) -> None:
        super().__init__()
        keep_time(self, discretization, tau_high=tau_high, dt=dt)

    @property
    def a(self) -> float | Tensor:
        """Share of the new sample that the high-pass takes in."""
        return ratio(self.tau_high, self.dt, self.discretization)

    def forward(self, x: Tensor, state: FilterState | None = None) -> tuple[Tensor, FilterState]:
        check_series(x, 3, state, FilterState)
        return self.scan(x, state)

    def scan(self, x: Tensor, state: FilterState | None) -> tuple[Tensor, FilterState]:
        """`forward` without checks, for modules that have checked x."""
        # A high-pass written out: on the few pixels of a strip nested modules take as long as the sums.
        low = state and state.low
        change, low = low_pass(x, low, self.tau_high, self.dt, -4, self.discretization, high=True)
        return change, FilterState(low)


class NDMinus(NDMin):
    """A speed sensor blind to uniform flicker: `HP(p_n) - (HP(p_{n-1}) + HP(p_{n+1})) / 2`. [A fig. 1b]

    The neighbours are those in x. Beyond the left and right border the image goes on with its border pixel,
    so that uniform flicker gives exactly zero there too.
    Shapes, arguments, state and errors as `NDMin`.
    """

    @trial_by_trial(1)
    def scan(self, x: Tensor, state: FilterState | None) -> tuple[Tensor, FilterState]:
        high, state = super().scan(x, state)
        before = torch.cat([high[..., :1], high[..., :-1]], dim=-1)
        after = torch.cat([high[..., 1:], high[..., -1:]], dim=-1)
        return high - (before + after) / 2, state


@safe_state
class NDSState(NamedTuple):
    """State of `NDS`: its high-pass and the low-pass of the neighbours' high-passed signals."""

    high: FilterState
    low: FilterState


class NDS(nn.Module):
    """The sensor found in flies: `HP(p_n) + LP(HP(p_{n-1})) + LP(HP(p_{n+1}))`. [A fig. 1a]

    `tau_low = 0` makes it the sum of three neighbouring `NDMin`, `tau_low = inf` makes it one `NDMin`.
    The neighbours are those in x; a border pixel's missing neighbour counts as zero, because a repeated one
    makes the border answer an edge more strongly than the rest of the image does (12 % in [A fig. 3]).

    Args:
        tau_high, tau_low: time constants in seconds, 0 to inf.
        dt: time step in seconds.
        discretization: as of `NDMin`.
    Shapes and errors as `NDMin`.
    """

    def __init__(
        self,
        tau_high: Seconds = 0.005,
        tau_low: Seconds = 0.0,
        dt: Seconds = 1 / 30,
        *,
        discretization: Discretization = "euler",
    ) -> None:
        super().__init__()
        self.high_pass = HighPass(tau_high, dt, discretization=discretization)
        self.low_pass = LowPass(tau_low, dt, discretization=discretization)

    @trial_by_trial(1, 1)
    def forward(self, x: Tensor, state: NDSState | None = None) -> tuple[Tensor, NDSState]:
        check_state(state, NDSState)
        high, high_state = self.high_pass(x, state and state.high)
        low, low_state = self.low_pass(high, state and state.low)
        padded = F.pad(low, (1, 1))
        return high + padded[..., :-2] + padded[..., 2:], NDSState(high_state, low_state)


@safe_state
class DirectionalState(NamedTuple):
    """State of `DirectionalND`: its sensor, the delayed outputs `[..., C, H, W]`, and frames seen (int64 scalar)."""

    sensor: FilterState
    delayed: Tensor
    frames: Tensor


class DirectionalND(nn.Module):
    """Direction of motion along rows by correlating neighboring non-directional sensors at a lower frame rate. [A §3]

    Every `every`-th output of `NDMin` goes into a Hassenstein-Reichardt correlation with its low-passed neighbors:
    what moves against the flow that a moving robot expects is an object of its own.

    Args:
        every: frames from one correlation to the next.
        tau_high: of the sensors, seconds.
        tau_low: delay of the correlation, seconds.
        dt: seconds between frames.

    Shapes:
        x `[..., T, C, H, W]` -> `[..., T', C, H, W - 1]`, T' about T / every, positive to the right, between
        two pixels.
        State: `DirectionalState`; `None` settles on the first frame.

    >>> x = torch.sin(0.3 * (torch.arange(40.0) - torch.arange(30.0)[:, None]))[:, None, None]  # moves right
    >>> out, state = DirectionalND(every=3)(x)
    >>> out.shape, bool(out[2:].mean() > 0)
    (torch.Size([10, 1, 1, 39]), True)
    """

    def __init__(
        self, every: int = 3, tau_high: Seconds = 0.005, tau_low: Seconds = 0.05, dt: Seconds = 1 / 30
    ) -> None:
        super().__init__()
        check_number("every", every, least=1, whole=True)
        self.every, self.sensor = every, NDMin(tau_high, dt)
        self.low_pass = LowPass(tau_low, dt * every)

    def forward(self, x: Tensor, state: DirectionalState | None = None) -> tuple[Tensor, DirectionalState]:
        check_state(state, DirectionalState)
        before = 0 if state is None else int(state.frames)
        high, sensor = self.sensor(x, state and state.sensor)
        first, delayed = -before % self.every, torch.zeros_like(high.select(-4, 0)) if state is None else state.delayed
        kept = high[..., first :: self.every, :, :, :]
        frames = torch.tensor(before + x.shape[-4])
        if kept.shape[-4] == 0:
            return kept[..., 1:], DirectionalState(sensor, delayed, frames)
        late, low = self.low_pass(kept, FilterState(delayed))
        return correlate(kept, late, -1), DirectionalState(sensor, low.low, frames)


SPEED_SCALE = 20.0
"""Factor from raw sensor output to the units of [A fig. 3]: about pixels per time step at contrast 0.5."""


def spatial_maximum(x: Tensor) -> Tensor:
    """Speed estimate of a camera: the largest magnitude over space. [A fig. 2]

    Args:
        x: sensor outputs `[..., T, C, H, W]`.
    Returns:
        `[..., T, C]`, one estimate for each channel.

    >>> spatial_maximum(torch.tensor([0.0, 0.0, 1.0, 0.0, 0.0]).view(1, 1, 1, 5))
    tensor([[1.]])
    """
    return x.flatten(-2).abs().amax(-1)


def speed_response(sensor: nn.Module, chunks: Iterable[Tensor], settle: int = 0) -> Tensor:
    """Mean over time of a sensor's speed estimate, `max over space of |output|`. [A Methods]

    Args:
        sensor: a module called as `output, state = sensor(frames, state)`, whose outputs are images
            `[..., T, C, H, W]`, such as `NDMin`.
        chunks: frames `[..., T, C, H, W]` in order, as from `FrameSource.chunks`.
        settle: number of first frames that are shown and not counted; [A] gives filters 5 time constants.

    Returns:
        `[..., C]`.

    Raises:
        InputError: when no frame is left to count.
    """
    estimates, state = list[Tensor](), None
    for frames in chunks:
        output, state = sensor(frames, state)
        estimates.append(spatial_maximum(output))
    count = sum(part.shape[-2] for part in estimates)
    if count <= settle:
        raise InputError(f"settle={settle} leaves none of the {count} frames to measure")
    return torch.cat(estimates, -2)[..., settle:, :].mean(-2)


class SpeedCurve(NamedTuple):
    """What [A Methods] looks for in a curve of responses against speed, each `[...]`.

    Attributes:
        monotonic_to: the highest speed up to which every faster image gave a larger response; 0 if none did.
        linearity: mean slope of the curve up to there over its slope at the lowest speed: 1 for a straight
            line, smaller the more it saturates, 0 where the sensor does not answer.
    """

    monotonic_to: Tensor
    linearity: Tensor


def judge_speed_curve(speeds: Tensor, responses: Tensor) -> SpeedCurve:
    """Measures for choosing time constants: range of monotonic increase first, then absence of saturation.

    Args:
        speeds: `[S]`, increasing from above 0.
        responses: `[..., S]`; an increase must be larger than 1e-6 to count.

    Raises:
        InputError: speeds that do not increase from above 0.
    """
    if not bool((torch.cat([speeds.new_zeros(1), speeds]).diff() > 0).all()):
        raise InputError("speeds must increase from above 0")
    origin = torch.zeros_like(responses[..., :1])
    curve = torch.cat([origin, responses], -1)
    steps = (curve.diff(dim=-1) > 1e-6).cumprod(-1).sum(-1)  # rises before the first one that fails
    reached = torch.cat([speeds.new_zeros(1), speeds])[steps]
    top = curve.gather(-1, steps.unsqueeze(-1)).squeeze(-1)
    answers = steps > 0
    straight = torch.where(answers, responses[..., 0] / speeds[0] * reached, torch.ones_like(top))
    return SpeedCurve(reached, torch.where(answers, top / straight, torch.zeros_like(top)))
