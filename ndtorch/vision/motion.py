"""Directional motion by elaborated Hassenstein-Reichardt detectors at every pixel."""

from __future__ import annotations

from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_state
from ndtorch.errors import InputError
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.frames import as_float, check_frames, grey, trial_by_trial
from ndtorch.vision.temporal import Discretization, Seconds, keep_time, low_pass

Border = Literal["wrap", "reflect"]
BORDERS: tuple[Border, ...] = ("wrap", "reflect")


def check_border(border: str) -> None:
    """Raise `InputError` unless `border` is one of `BORDERS`."""
    if border not in BORDERS:
        raise InputError(f"border must be one of {', '.join(BORDERS)}, got {border!r}")


# From (across, its magnitude, along, its magnitude) to left, right, down, up.
BY_DIRECTION = [[-0.5, 0.5, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0], [0.0, 0.0, 0.5, -0.5], [0.0, 0.0, 0.5, 0.5]]


@safe_state
class MotionState(NamedTuple):
    """State of the detectors: the slow and the delayed low-passed image, each `[..., H, W]`."""

    slow: Tensor
    delayed: Tensor


def correlate(high: Tensor, delayed: Tensor, dim: int) -> Tensor:
    """Opponent correlation of neighbours along `dim`: `PH(n+1) PHL(n) - PH(n) PHL(n+1)`. [B eq. 7-8]

    Positive where the pattern moves towards larger indices (right along columns, down along rows).
    The result is one shorter than the input along `dim`.
    """
    n = high.shape[dim] - 1
    forward = high.narrow(dim, 1, n) * delayed.narrow(dim, 0, n)
    return torch.addcmul(forward, high.narrow(dim, 0, n), delayed.narrow(dim, 1, n), value=-1)


def signed_sums(high: Tensor, delayed: Tensor, border: Border) -> Tensor:
    """Sums of the opponent correlation and of its magnitude along rows, then along columns, `[..., 4]`."""
    sums = []
    for dim in (-1, -2):
        inner = correlate(high, delayed, dim)
        total, size = inner.sum((-1, -2)), inner.abs_().sum((-1, -2))
        if border == "wrap":
            # The last line and the first, where the torus closes.
            edge = high.select(dim, 0) * delayed.select(dim, -1)
            edge = torch.addcmul(edge, high.select(dim, -1), delayed.select(dim, 0), value=-1)
            total, size = total + edge.sum(-1), size + edge.abs_().sum(-1)
        sums += [total, size]
    return torch.stack(sums, -1)


class HassensteinReichardt(nn.Module):
    """Four images of directional motion: left, right, down, up. [B eq. 7-13]

    Grey = mean of the color planes; PH = high-pass of 0.5 s, PHL = PH low-passed at 50 ms; neighbouring
    pixels are cross-correlated along rows and columns and split by sign. `down` is what a falling bar drives.

    Args:
        dt: seconds between frames.
        tau_high, tau_low: time constants in seconds; numbers, or tensors, which as `torch.nn.Parameter` are learned.
        border: "wrap" correlates the last with the first row and column (toroidal scenes); with "reflect"
            those pairs are left out and their pixels are zero (real video).
        discretization: of the filters, "euler" (as published) or "exact", see `smoothing_factor`.

    Shapes:
        frames `[..., T, C, H, W]`, C = 3 or 1 -> `[..., T, 4, H, W]`. State: `MotionState`;
        `None` settles the filters on the first frame.
    """

    directions: Tensor
    tau_high: Seconds
    tau_low: Seconds
    dt: Seconds
    discretization: Discretization

    def __init__(
        self,
        dt: Seconds = 0.01,
        tau_high: Seconds = 0.5,
        tau_low: Seconds = 0.05,
        border: Border = "wrap",
        *,
        discretization: Discretization = "euler",
    ) -> None:
        super().__init__()
        check_border(border)
        self.border = border
        keep_time(self, discretization, tau_high=tau_high, tau_low=tau_low, dt=dt)
        self.register_buffer("directions", torch.tensor(BY_DIRECTION), persistent=False)

    def scan(self, images: Tensor, state: MotionState | None) -> tuple[Tensor, Tensor, MotionState]:
        """Run the temporal filters over grey images `[..., T, H, W]`; returns PH, PHL and the state. [B eq. 7-8]"""
        first = images.select(-3, 0)
        slow, delayed = (first, torch.zeros_like(first)) if state is None else state
        high, slow = low_pass(images, slow, self.tau_high, self.dt, -3, self.discretization, high=True)
        late, delayed = low_pass(high, delayed, self.tau_low, self.dt, -3, self.discretization)
        return high, late, MotionState(slow, delayed)

    def images(self, high: Tensor, delayed: Tensor) -> Tensor:
        """Feature images `[..., 4, H, W]` from PH and PHL `[..., H, W]`."""
        signed = []
        for dim in (-1, -2):
            if self.border == "wrap":  # the first line follows the last one
                fast, late = (torch.cat([image, image.narrow(dim, 0, 1)], dim) for image in (high, delayed))
                signed.append(correlate(fast, late, dim))
            else:
                inner = correlate(high, delayed, dim)
                signed.append(torch.cat([inner, torch.zeros_like(high.narrow(dim, 0, 1))], dim))
        right, down = signed
        return torch.stack([-right, right, down, -down], -3).clamp_min_(0)

    def sums(self, high: Tensor, delayed: Tensor) -> Tensor:
        """Spatial sums of the four images, `[..., 4]`, without making the images."""
        signed = signed_sums(high, delayed, self.border)
        # The positive part of a signed image sums to half of (sum of magnitudes + sum). Rounding can leave -1e-7 of the
        # sum where nothing moves in a direction.
        return (signed @ self.directions.to(signed.dtype)).clamp_min(0)

    @trial_by_trial(2, 2)
    def forward(self, frames: Tensor, state: MotionState | None = None) -> tuple[Tensor, MotionState]:
        check_state(state, MotionState)
        image = grey(as_float(check_frames(frames)))
        high, delayed, state = self.scan(image, state)
        return self.images(high, delayed), state
