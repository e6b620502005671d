"""From the rate of the frames to the time step of the networks."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_alike, check_state, check_tensor, is_finite
from ndtorch.errors import InputError
from ndtorch.vision.temporal import time_dim


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
        self.ratio = dt_out / dt_in
        self.identity = math.isclose(dt_in, dt_out, rel_tol=1e-9)

    def forward(self, x: Tensor, state: ResampleState | None = None) -> tuple[Tensor, ResampleState]:
        check_state(state, ResampleState)
        time_dim(x, 1)
        check_tensor("x", x)
        if self.identity:
            steps = counter(0) if state is None else state.taken
            return x, ResampleState(x[..., -1, :], steps + x.shape[-2], steps + x.shape[-2])
        taken = 0 if state is None else int(state.taken)
        given = 0 if state is None else int(state.given)
        last = x[..., 0, :] if state is None else state.last
        check_alike("state.last", last, x[..., 0, :])
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
        return out, ResampleState(x[..., -1, :], counter(end), counter(max(upto, given)))


def counter(n: int) -> Tensor:
    return torch.tensor(n, dtype=torch.int64)
