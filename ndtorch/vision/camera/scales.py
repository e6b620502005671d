"""Motion at the image scale that suits the displacement: detectors on a pyramid, and the choice among its levels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from ndtorch.vision.camera.params import CameraParams
from ndtorch.vision.motion import MotionState, correlate, motion_step

LEVELS = 3


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


def shift_per_delay(state: ScaleState, dt: float, tau_low: float) -> Tensor:
    """Root mean square displacement within a detector's delay, pixels of the fine image, `[]` float64.

    It is 0 before anything moved.

    From the coarse image, where displacements are small: `v^2 = 2 <(dI/dt)^2> / <|grad I|^2>`, the 2 for edges that
    stand in all directions.
    """
    change, slope = state.change.double(), state.slope.double()
    per_frame = 2 ** (LEVELS - 1) * (2 * change / slope).sqrt()
    return torch.where(slope > 0, per_frame * (tau_low + dt) / dt, 0.0)


def best_level(shift: Tensor, best: float) -> Tensor:
    """The level of the pyramid on which a displacement `[]` comes nearest to the `best` one, in octaves, `[]` int64.

    Less is weak, more is mistaken for the other way.
    """
    octave = sum((shift > best * 2 ** (k + 0.5)).long() for k in range(LEVELS - 1))
    return torch.where(shift > 0, octave, 1)


def halfway(between: Tensor, dim: int) -> Tensor:
    """What lies between neighbours along `dim`, half on each of them: one longer than the input.

    So the motion of a mirror image is the mirror image of the motion, in its place too.
    """
    before, after = ((1, 0), (0, 1)) if dim == -1 else ((0, 0, 1, 0), (0, 0, 0, 1))
    return 0.5 * (F.pad(between, before) + F.pad(between, after))


def scale_step(
    image: Tensor, state: ScaleState, dt: float, a_high: float, a_low: float, params: CameraParams
) -> tuple[dict[int, Tensor], Tensor, ScaleState]:
    """Opponent motion to the right and downward at the chosen scale. [B eq. 7-8 on a pyramid]

    What is exported cannot leave out a level by what it saw: it makes them all, and its caller picks.

    Args:
        image: difference from the background, `[C, H, W]`; motion is summed over its colors, so that a green thing
            on a red ground of the same brightness is seen to move.
        dt, a_high, a_low: time step and smoothing factors of the detectors.
        params: their delay, and the level, fixed or the one that suits the displacement measured so far.

    Returns:
        `[2, H / 2^k, W / 2^k]` by level k, positive to the right and downward, of the chosen one, or of all where this
        is exported; the chosen level `[]` int64; the state.
    """
    tau_low, level = params.tau_low, None if params.scale == "auto" else params.scale
    images = pyramid(image)
    coarse = images[-1]
    change = (coarse - state.last).square().sum()
    slope = torch.diff(coarse, dim=-1).square().sum() + torch.diff(coarse, dim=-2).square().sum()
    keep = math.exp(-dt / params.tau_shift)
    measured = state._replace(last=coarse, change=keep * state.change + change, slope=keep * state.slope + slope)
    # What decays for minutes must not become a division of two roundings.
    tiny = measured.slope < 1e-9
    measured = measured._replace(
        change=torch.where(tiny, 0.0, measured.change), slope=torch.where(tiny, 0.0, measured.slope)
    )
    chosen = (
        best_level(shift_per_delay(measured, dt, tau_low), params.best_shift)
        if level is None
        else torch.tensor(level, device=image.device)
    )
    wanted: Sequence[int] = (level,) if level is not None else range(LEVELS)
    if not torch.compiler.is_compiling():
        wanted = (int(chosen),)
    filters = [state.fine, state.middle, state.coarse]
    moved = {}
    for k, img in enumerate(images):
        high, delayed, filters[k] = motion_step(img, filters[k], a_high, a_low)
        if k in wanted:
            moved[k] = torch.stack([halfway(correlate(high, delayed, dim).sum(-3), dim) for dim in (-1, -2)])
    return moved, chosen, measured._replace(fine=filters[0], middle=filters[1], coarse=filters[2])
