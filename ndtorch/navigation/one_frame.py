"""One frame and one car: what steps by one kernel take apart and put together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.navigation.controllers.contract import Command
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.ranging import Ranges


def one_of(driven: Command) -> Command:
    """Of the one frame."""
    return Command(driven.speed[0], driven.curvature[0])


def as_array(frame: Tensor) -> tuple[Any, bool]:
    """A frame `[1, C, H, W]` as an array without gaps, and whether that is `[1, H, W, C]`: colors beside each other."""
    if frame.is_contiguous():
        return frame.numpy(), False
    if frame.ndim == 4:
        last = frame.permute(0, 2, 3, 1)
        if last.is_contiguous():
            return last.numpy(), True
    return frame.contiguous().numpy(), False


def numpy_kind(kind: torch.dtype) -> Any:
    """The precision of an image as NumPy calls it."""
    return np.dtype(np.float64 if kind == torch.float64 else np.float32)


def in_frames(ranges: Ranges, pose: Pose) -> tuple[Ranges, Pose]:
    """Ranges `[..., 1, n]` and poses `[..., 1]` of the one frame."""
    return Ranges(*(part.unsqueeze(-2) for part in ranges)), Pose(*(part.unsqueeze(-1) for part in pose))


def take_over(new: tuple[Sequence[Tensor], Sequence[Tensor]], told: tuple[Sequence[Tensor], Sequence[Tensor]]) -> None:
    """Write into a state of `QuickControl.take` that was just made what is another in the one that was told more."""
    for ours, theirs in zip(new, told, strict=True):
        for mine, other in zip(ours, theirs, strict=True):
            if mine is not other:
                mine.copy_(other)
