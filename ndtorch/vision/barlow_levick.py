"""Direction by inhibition: the detectors of Barlow and Levick (1965)."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_number, check_state
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.frames import as_float, check_frames, grey, trial_by_trial
from ndtorch.vision.motion import Border, check_border
from ndtorch.vision.temporal import Discretization, Seconds, keep_time, low_pass


@safe_state
class VetoState(NamedTuple):
    """State of `BarlowLevick`: slow image `[..., H, W]`, and ON and OFF inhibition `[..., 2, H, W]`."""

    slow: Tensor
    inhibition: Tensor


class BarlowLevick(nn.Module):
    """Four images of directional motion, left, right, down, up, where the null direction is vetoed.

    A detector is excited at its own place and inhibited, later and for longer, from its neighbor on the null side,
    `R(x) = max(0, E(x) - veto LP(E(x + 1)))` for motion to the right, of ON and of OFF changes each, `E` the positive
    and the negative part of a high-pass. Motion in the preferred direction excites before it inhibits; in the null
    direction the inhibition is there first. Unlike `HassensteinReichardt` it answers flicker too, and single changes.

    Source: Barlow, H. B. & Levick, W. R. (1965). The mechanism of directionally selective units in rabbit's retina.
    J. Physiol. 178, 477-504.

    Args:
        dt: seconds between frames.
        tau_high: time constant of the high-pass, seconds.
        tau_low: delay of the inhibition, seconds. Both may be `torch.nn.Parameter`.
        veto: strength of the inhibition.
        border: "wrap" closes the image to a torus; with "reflect" pixels without a neighbor are zero.
        discretization: of the filters, "euler" or "exact", see `smoothing_factor`.

    Shapes:
        frames `[..., T, C, H, W]`, C = 3 or 1 -> `[..., T, 4, H, W]`, not negative. State: `VetoState`; `None` settles
        on the first frame.

    Raises:
        InputError: frames that cannot be used, or constants out of range.

    >>> flash = torch.zeros(9, 1, 1, 8)
    >>> flash[1:, ..., 3], flash[5:, ..., 4] = 1.0, 1.0  # one place, then the one to its right
    >>> left, right, down, up = BarlowLevick(dt=0.02)(flash)[0].sum((0, 2, 3))
    >>> bool(right > 1.3 * left)
    True
    """

    dt: Seconds
    tau_high: Seconds
    tau_low: Seconds
    discretization: Discretization

    def __init__(
        self,
        dt: Seconds = 0.01,
        tau_high: Seconds = 0.1,
        tau_low: Seconds = 0.05,
        veto: float = 4.0,
        border: Border = "wrap",
        *,
        discretization: Discretization = "euler",
    ) -> None:
        super().__init__()
        check_border(border)
        check_number("veto", veto, least=0)
        keep_time(self, discretization, tau_high=tau_high, tau_low=tau_low, dt=dt)
        self.veto, self.border = float(veto), border

    @trial_by_trial(2, 1)
    def forward(self, frames: Tensor, state: VetoState | None = None) -> tuple[Tensor, VetoState]:
        check_state(state, VetoState)
        image = grey(as_float(check_frames(frames)))
        slow, inhibition = (None, None) if state is None else state
        high, slow = low_pass(image, slow, self.tau_high, self.dt, -3, self.discretization, high=True)
        excited = torch.stack([high, -high], -3).clamp_min_(0)
        start = torch.zeros_like(excited.select(-4, 0)) if inhibition is None else inhibition
        delayed, inhibition = low_pass(excited, start, self.tau_low, self.dt, -4, self.discretization)
        out = [
            (excited - self.veto * delayed.roll(step, dim)).clamp_min(0).sum(-3)
            for step, dim in ((1, -1), (-1, -1), (-1, -2), (1, -2))  # the neighbor from which null motion comes
        ]
        if self.border == "reflect":
            for images, edge, dim in zip(out, (0, -1, -1, 0), (-1, -1, -2, -2), strict=True):
                images.select(dim, edge).zero_()
        return torch.stack(out, -3), VetoState(slow, inhibition)
