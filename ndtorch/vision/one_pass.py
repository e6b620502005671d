"""The ten sums of frames on the CPU by kernels: the numbers of `VisualFeatures`, with one pass over the pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.kernels.load import kernel
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.vision.motion import HassensteinReichardt, MotionState

KINDS = (torch.uint8, torch.float32, torch.float64)


def one_pass_fits(frames: Tensor, state: MotionState | None) -> bool:
    """Whether frames `[T, 3, H, W]` and the state after the frame before them can go to the kernels."""
    if frames.ndim != 4 or frames.dtype not in KINDS or not kernels_wanted(frames, *(state or ())):
        return False
    return state is None or all(s.shape == frames.shape[-2:] and s.dtype == image_kind(frames) for s in state)


def image_kind(frames: Tensor) -> torch.dtype:
    """Precision of the grey images of frames."""
    return torch.float64 if frames.dtype == torch.float64 else torch.float32


def pixels(frame: Tensor) -> tuple[Any, bool]:
    """A frame `[3, H, W]` as an array without gaps, and whether that is `[H, W, 3]`: colors beside each other."""
    if frame.is_contiguous():
        return frame.numpy(), False
    last = frame.permute(1, 2, 0)
    return (last.numpy(), True) if last.is_contiguous() else (frame.contiguous().numpy(), False)


def pass_over(
    frame: Tensor,
    state: MotionState | None,
    motion: HassensteinReichardt,
    block: int,
    margin: int,
    into: MotionState,
    sums: Any,
) -> Tensor:
    """Grey rows `[(H + 2 margin) / block, W]` of one frame, and its motion and color sums.

    Args:
        frame: `[3, H, W]`.
        state, into: before and after it; `into` is written, and may be `state`. None is settled on the frame.
        motion: the detectors.
        block, margin: see the kernel.
        sums: array that gets them, `[7]` as of the kernel.
    """
    return by_kernel("front_end", frame, state, motion, (block, margin), into, sums)


def field_pass(
    frame: Tensor,
    state: MotionState | None,
    motion: HassensteinReichardt,
    thinning: tuple[int, int],
    into: MotionState,
    tables: list[Any],
    sums: Any,
) -> Tensor:
    """Grey rows as of `pass_over`, which has the other arguments, and motion and color of every field into `sums`.

    Args:
        thinning: block and margin.
        tables, sums: the last arguments of the kernel.
    """
    return by_kernel("local_sums", frame, state, motion, thinning, into, *tables, sums)


def by_kernel(
    name: str,
    frame: Tensor,
    state: MotionState | None,
    motion: HassensteinReichardt,
    thinning: tuple[int, int],
    into: MotionState,
    *rest: Any,
) -> Tensor:
    """One pass over a frame: the grey rows."""
    given, beside = pixels(frame)
    block, margin = thinning
    unit = 1 / 255 if frame.dtype == torch.uint8 else 1.0
    if state is not None and state is not into:
        for part, before in zip(into, state, strict=True):
            part.copy_(before)
    slow, delayed = (part.numpy() for part in into)
    rows = np.empty(((slow.shape[0] + 2 * margin) // block, slow.shape[1]), slow.dtype)
    kernel(name, (given.dtype, slow.dtype)).run(
        given,
        beside,
        unit,
        state is None,
        slow,
        delayed,
        motion.a_high,
        motion.a_low,
        motion.border == "wrap",
        block,
        margin,
        rows,
        *rest,
    )
    return torch.from_numpy(rows)


def fresh(frames: Tensor) -> MotionState:
    """Memory for the state after frames `[T, 3, H, W]`, without anything in it."""
    return MotionState(*(torch.empty(frames.shape[-2:], dtype=image_kind(frames)) for _ in range(2)))
