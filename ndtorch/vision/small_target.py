"""Small targets that move: elementary small target motion detectors (ESTMD)."""

from __future__ import annotations

from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ndtorch.arguments import FullPrecision, check_number, check_state
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.frames import as_float, check_frames, grey, trial_by_trial
from ndtorch.vision.temporal import Seconds, keep_time, low_pass, low_pass_step, ratio


@safe_state
class SmallTargetState(NamedTuple):
    """State of `SmallTargetDetector`: slow image `[..., H, W]`, adaptation of ON and OFF `[..., 2, H, W]`, and the
    delayed OFF signal `[..., H, W]`."""

    slow: Tensor
    adapted: Tensor
    delayed: Tensor


class SmallTargetDetector(FullPrecision):
    """Images that are bright where a small dark target moves, whichever way it goes (ESTMD).

    A dark target darkens a pixel and, as it leaves, brightens it again. High-passed images are split into ON and OFF;
    each adapts fast to what grows and slowly to what falls, and is inhibited by its surround,
    `c = max(0, x - inhibition mean(x in the ring))`, which silences what is extended, such as a long edge.
    The response is `ON LP(OFF)`: both within the delay at one place, so wide and slow targets give none, and a longer
    delay prefers slower ones. Preferred are heights up to `2 inner + 1` pixels.

    Source: Wiederman, S. D., Shoemaker, P. A. & O'Carroll, D. C. (2008). A model for the detection of moving targets in
    visual clutter inspired by insect physiology. PLoS ONE 3, e2784. The optics before and the sampling of the eye are
    left to the frames.

    Args:
        dt: seconds between frames.
        tau_high: time constant of the high-pass, seconds.
        tau_delay: delay of OFF, seconds. Both may be `torch.nn.Parameter`.
        tau_rise, tau_fall: time constants of the adaptation to what grows and to what falls, seconds.
        inhibition: strength of the surround.
        inner, outer: half side of the square in the middle that does not inhibit, and of the ring around it, pixels.
        dark: whether targets are darker than the ground; False for bright ones.

    Shapes:
        frames `[..., T, C, H, W]`, C = 3 or 1 -> `[..., T, 1, H, W]`, not negative. State: `SmallTargetState`; `None`
        settles on the first frame.

    Raises:
        InputError: frames that cannot be used, or constants out of range.

    >>> film = torch.ones(20, 1, 24, 24)
    >>> for t in range(20):
    ...     film[t, 0, 12, t : t + 2] = 0.0  # a dark target goes right
    >>> response, state = SmallTargetDetector()(film)
    >>> int(response[-1].sum((0, 2)).argmax())  # its row
    12
    """

    dt: Seconds
    tau_high: Seconds
    tau_delay: Seconds
    tau_rise: float
    tau_fall: float

    def __init__(
        self,
        dt: Seconds = 0.01,
        tau_high: Seconds = 0.04,
        tau_delay: Seconds = 0.025,
        tau_rise: float = 0.003,
        tau_fall: float = 0.07,
        inhibition: float = 10.0,
        inner: int = 1,
        outer: int = 3,
        dark: bool = True,
    ) -> None:
        super().__init__()
        check_number("inhibition", inhibition, least=0)
        check_number("inner", inner, least=0, whole=True)
        check_number("outer", outer, above=inner, whole=True)
        keep_time(self, tau_high=tau_high, tau_delay=tau_delay, tau_rise=tau_rise, tau_fall=tau_fall, dt=dt)
        self.inhibition, self.inner, self.outer, self.dark = float(inhibition), inner, outer, dark

    @trial_by_trial(2, 1, 2)
    def forward(self, frames: Tensor, state: SmallTargetState | None = None) -> tuple[Tensor, SmallTargetState]:
        check_state(state, SmallTargetState)
        image = grey(as_float(check_frames(frames)))
        slow, adapted, delayed = (None, None, None) if state is None else state
        high, slow = low_pass(image, slow, self.tau_high, self.dt, -3, high=True)
        signals = torch.stack([high, -high] if self.dark else [-high, high], -3).clamp_min_(0)  # [..., T, 2, H, W]
        rise, fall = (torch.as_tensor(ratio(tau, self.dt)).to(signals) for tau in (self.tau_rise, self.tau_fall))
        adapted = torch.zeros_like(signals.select(-4, 0)) if adapted is None else adapted
        kept = []
        for sample in signals.unbind(-4):
            adapted = low_pass_step(sample, adapted, torch.where(sample > adapted, rise, fall))
            kept.append((sample - adapted).clamp_min(0))
        on, off = self.apart(torch.stack(kept, -4)).unbind(-3)
        start = torch.zeros_like(off.select(-3, 0)) if delayed is None else delayed
        late, delayed = low_pass(off, start, self.tau_delay, self.dt, -3)
        return (on * late).unsqueeze(-3), SmallTargetState(slow, adapted, delayed)

    def apart(self, signals: Tensor) -> Tensor:
        """Signals less the mean of the ring around each pixel, where positive; the image goes on at its border."""
        half, middle, flat = self.outer, self.inner, signals.reshape(-1, 1, *signals.shape[-2:])
        padded = F.pad(flat, (half, half, half, half), "replicate")
        square = F.avg_pool2d(padded, 2 * half + 1, 1) * (2 * half + 1) ** 2
        rest = half - middle
        cut = padded[..., rest : padded.shape[-2] - rest, rest : padded.shape[-1] - rest]
        inside = F.avg_pool2d(cut, 2 * middle + 1, 1) * (2 * middle + 1) ** 2
        ring = (square - inside) / ((2 * half + 1) ** 2 - (2 * middle + 1) ** 2)
        return (signals - self.inhibition * ring.reshape(signals.shape)).clamp_min(0)
