"""Looming: what comes nearer, by motion outward in all directions and the size of its outline."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.arguments import FullPrecision, check_number, check_size, check_state, without_autocast
from ndtorch.utils.tensors import safe_state
from ndtorch.vision.frames import as_float, check_frames, grey
from ndtorch.vision.motion import HassensteinReichardt, MotionState


@safe_state
class LoomingState(NamedTuple):
    """State of `LoomingDetector`: motion detectors, and the followed angle and its slower mean `[...]`, radians, -1
    while nothing moves."""

    motion: MotionState
    angle: Tensor
    slow: Tensor


class LoomingDetector(FullPrecision):
    """Response to an object that approaches the middle of the frame, before it would collide.

    As in the neuron LPLC2 of flies, motion outward is summed over four arms, left, right, below and above the middle,
    less motion inward, and all four must be excited: what recedes or passes by excites none or some. Where motion
    outward lies gives the angle theta that the object spans, and the response is that of the locust's LGMD,
    `eta = b theta' exp(-alpha theta)`, b the balance of the arms, 0 to 1. For a disc of half size l at speed v it is
    largest at `theta = 2 atan(1 / alpha)`, that is `alpha l / v` before collision; here a tenth later, since motion is
    seen a little within the outline.

    Sources: Klapoetke, N. C. et al. (2017). Ultra-selective looming detection from radial motion opponency. Nature 551,
    237-241. Gabbiani, F., Krapp, H. G. & Laurent, G. (1999). Computation of object approach by a wide-field,
    motion-sensitive neuron. J. Neurosci. 19, 1122-1141.

    Args:
        size: height and width of the frames, pixels.
        dt: seconds between frames.
        pixel: angle of a pixel in the middle, radians.
        alpha: weight of the size; 4.7 has its peak at 24 degrees.
        tau: time constant of the smoothed angle and of its rate, seconds.
        tau_high, tau_low: time constants of the motion detectors, seconds.

    Shapes:
        frames `[..., T, C, H, W]`, C = 3 or 1 -> `[..., T]`, radians a second. State: `LoomingState`.

    Raises:
        InputError: frames that cannot be used, or constants out of range.

    >>> rows, columns = torch.meshgrid(torch.arange(64.0) - 31.5, torch.arange(64.0) - 31.5, indexing="ij")
    >>> radii = torch.linspace(3.0, 25.0, 40)[:, None, None]
    >>> film = torch.sigmoid((torch.hypot(rows, columns) - radii) * 2).unsqueeze(1)  # a dark disc that grows
    >>> looms, recedes = (float(LoomingDetector((64, 64))(x)[0].max()) for x in (film, film.flip(0)))
    >>> looms > 20 * recedes
    True
    """

    arms: Tensor
    distance: Tensor

    def __init__(
        self,
        size: tuple[int, int],
        dt: float = 0.01,
        pixel: float = math.radians(1),
        alpha: float = 4.7,
        tau: float = 0.02,
        tau_high: float = 0.05,
        tau_low: float = 0.01,
    ) -> None:
        super().__init__()
        check_size("size", size, 4)
        for name, value in {"dt": dt, "pixel": pixel, "tau": tau}.items():
            check_number(name, value, above=0)
        check_number("alpha", alpha, least=0)
        self.size, self.dt, self.pixel, self.alpha, self.tau = size, dt, pixel, float(alpha), tau
        self.motion = HassensteinReichardt(dt, tau_high, tau_low, "reflect")
        row, column = (torch.arange(n) - (n - 1) / 2 for n in size)
        down, right = torch.meshgrid(row, column, indexing="ij")
        across = right.abs() >= down.abs()
        arms = [across & (right < 0), across & (right > 0), ~across & (down > 0), ~across & (down < 0)]
        self.register_buffer("arms", torch.stack(arms).float(), persistent=False)
        self.register_buffer("distance", torch.hypot(down, right), persistent=False)

    @without_autocast
    def forward(self, frames: Tensor, state: LoomingState | None = None) -> tuple[Tensor, LoomingState]:
        check_state(state, LoomingState)
        image = grey(as_float(check_frames(frames, self.size, self.arms.device)))
        high, late, motion = self.motion.scan(image, state and state.motion)
        seen = self.motion.images(high, late)  # left, right, down, up, as the arms
        outward = (seen - seen[..., [1, 0, 3, 2], :, :]) * self.arms.to(seen)
        each, total = outward.sum((-1, -2)), seen.sum((-1, -2, -3))
        moving = total > 1e-6 * image.shape[-1] * image.shape[-2]
        balance = torch.where(moving, 4 * each.amin(-1).clamp_min(0) / total.where(moving, 1.0), 0.0)
        weights = outward.clamp_min(0).sum(-3).square()  # most of it at the outline, not on the way behind it
        sums = weights.sum((-1, -2))
        radius = (weights * self.distance.to(seen)).sum((-1, -2)) / sums.where(sums > 0, 1.0)
        angles = 2 * torch.atan(radius * math.tan(self.pixel))
        none = torch.full_like(total.select(-1, 0), -1.0)
        angle, slow = (none, none) if state is None else (state.angle, state.slow)
        followed, rates, a = [], [], self.dt / (self.tau + self.dt)
        for new, moves in zip(angles.unbind(-1), (moving & (sums > 0)).unbind(-1), strict=True):
            # Follow the angle from the first that is seen, and end where nothing moves.
            angle = torch.where(moves, torch.where(angle < 0, new, torch.lerp(angle, new, a)), none)
            slow = torch.where(moves, torch.where(slow < 0, angle, torch.lerp(slow, angle, a)), none)
            followed.append(angle)
            rates.append((angle - slow).clamp_min(0) / self.tau)
        size = torch.exp(-self.alpha * torch.stack(followed, -1).clamp_min(0))
        return balance * torch.stack(rates, -1) * size, LoomingState(motion, angle, slow)
