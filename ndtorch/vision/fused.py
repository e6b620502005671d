"""One step of the front end written for torch.compile: few passes over the pixels instead of one per operation."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.vision.motion import Border, MotionState, correlate, motion_step, wrapped_edge


def front_step(
    frame: Tensor, state: MotionState, a_high: float, a_low: float, border: Border
) -> tuple[Tensor, Tensor, Tensor, MotionState]:
    """Everything that is done to a frame but orientation. Compile it; as it stands it is no faster than the parts.

    Shapes: frame `[..., 3, H, W]` float -> color sums `[..., 3]`, `signed_sums` `[..., 4]`, grey image
    `[..., H, W]`, new state.
    """
    red, green, blue = frame.unbind(-3)
    image = (red + green + blue) * (1 / 3)
    high, delayed, state = motion_step(image, state, a_high, a_low)
    return frame.sum((-1, -2)), fused_signed_sums(high, delayed, border), image, state


def fused_signed_sums(high: Tensor, delayed: Tensor, border: Border) -> Tensor:
    """As `signed_sums`, with all but the last lines in one loop over the pixels, `[..., 4]`."""

    def sums_of(across: Tensor, along: Tensor) -> Tensor:
        return torch.stack([across.sum(-1), across.abs().sum(-1), along.sum(-1), along.abs().sum(-1)], -1)

    here, there = high[..., :-1, :-1], delayed[..., :-1, :-1]
    across = high[..., :-1, 1:] * there - here * delayed[..., :-1, 1:]
    along = high[..., 1:, :-1] * there - here * delayed[..., 1:, :-1]
    last_row = correlate(high[..., -1:, :], delayed[..., -1:, :], -1).flatten(-2)
    last_column = correlate(high[..., -1:], delayed[..., -1:], -2).flatten(-2)
    sums = sums_of(across, along).sum(-2) + sums_of(last_row, last_column)
    if border == "wrap":
        edges = (correlate(wrapped_edge(high, dim), wrapped_edge(delayed, dim), dim).flatten(-2) for dim in (-1, -2))
        sums = sums + sums_of(*edges)
    return sums
