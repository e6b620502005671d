"""Motion at the image scale that suits the displacement: detectors on a pyramid, and the choice among its levels."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ndtorch.vision.motion import MotionState, correlate, motion_step

LEVELS = 3
BEST_SHIFT = 1.5
"""Pixels that a pattern should move within a detector's delay: less is weak, more is mistaken for the other way."""
MEMORY = 1.0
"""Seconds over which the displacement is measured."""


class ScaleState(NamedTuple):
    """State of the pyramid.

    Attributes:
        fine, middle, coarse: detectors' filters at 1, 2 and 4 pixels, each `[C, H', W']`.
        last: the latest coarse image.
        change, slope: running sums of squares of its changes in time and in space, `[]`.
    """

    fine: MotionState
    middle: MotionState
    coarse: MotionState
    last: Tensor
    change: Tensor
    slope: Tensor


def pyramid(image: Tensor) -> list[Tensor]:
    """The image `[C, H, W]` and its two halvings (H and W are multiples of 4)."""
    images = [image]
    for _ in range(LEVELS - 1):
        images.append(F.avg_pool2d(images[-1], 2))
    return images


def scale_start(image: Tensor) -> ScaleState:
    """State settled on one difference image `[C, H, W]`."""
    images = pyramid(image)
    fine, middle, coarse = (MotionState(i, torch.zeros_like(i)) for i in images)
    zero = image.new_zeros(())
    return ScaleState(fine, middle, coarse, images[-1], zero, zero)


def shift_per_delay(state: ScaleState, dt: float, tau_low: float) -> float:
    """Root mean square displacement within a detector's delay, pixels of the fine image; 0 before anything moved.

    From the coarse image, where displacements are small: `v^2 = 2 <(dI/dt)^2> / <|grad I|^2>`, the 2 for edges that
    stand in all directions.
    """
    if float(state.slope) <= 0:
        return 0.0
    per_frame = 2 ** (LEVELS - 1) * math.sqrt(2 * float(state.change) / float(state.slope))
    return float(per_frame * (tau_low + dt) / dt)


def best_level(shift: float) -> int:
    """The level of the pyramid on which a displacement comes nearest to `BEST_SHIFT`, in octaves."""
    if shift <= 0:
        return 1
    return min(LEVELS - 1, max(0, round(math.log2(shift / BEST_SHIFT))))


def scale_step(
    image: Tensor, state: ScaleState, dt: float, a_high: float, a_low: float, tau_low: float, level: int | None = None
) -> tuple[Tensor, int, ScaleState]:
    """Opponent motion to the right and downward at the chosen scale. [B eq. 7-8 on a pyramid]

    Args:
        image: difference from the background, `[C, H, W]`; motion is summed over its colours, so that a green thing
            on a red ground of the same brightness is seen to move.
        dt, a_high, a_low, tau_low: time step, smoothing factors and delay of the detectors.
        level: fixed level; None for the one that suits the displacement measured so far.

    Returns:
        `[2, H / 2^level, W / 2^level]`, positive to the right and downward; the level; the state.
    """
    images = pyramid(image)
    coarse = images[-1]
    change = (coarse - state.last).square().sum()
    slope = torch.diff(coarse, dim=-1).square().sum() + torch.diff(coarse, dim=-2).square().sum()
    keep = math.exp(-dt / MEMORY)
    measured = state._replace(last=coarse, change=keep * state.change + change, slope=keep * state.slope + slope)
    # What decays for minutes must not become a division of two roundings.
    if float(measured.slope) < 1e-9:
        measured = measured._replace(change=torch.zeros_like(change), slope=torch.zeros_like(slope))
    chosen = best_level(shift_per_delay(measured, dt, tau_low)) if level is None else level
    filters = [state.fine, state.middle, state.coarse]
    out = None
    for k, img in enumerate(images):
        high, delayed, filters[k] = motion_step(img, filters[k], a_high, a_low)
        if k == chosen:
            across = F.pad(correlate(high, delayed, -1), (0, 1)).sum(-3)
            along = F.pad(correlate(high, delayed, -2), (0, 0, 0, 1)).sum(-3)
            out = torch.stack([across, along])
    assert out is not None
    return out, chosen, measured._replace(fine=filters[0], middle=filters[1], coarse=filters[2])
