"""The ten sums of frames on the CPU by kernels: the numbers of `VisualFeatures`, with one pass over the pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ndtorch.utils.backend import Backend, kernels_wanted
from ndtorch.vision._kernels_frame import PassConstants, front_end
from ndtorch.vision.decimation import Thinning
from ndtorch.vision.frames import check_range, rows_apart
from ndtorch.vision.motion import HassensteinReichardt, MotionState

KINDS = (torch.uint8, torch.float32, torch.float64)


def one_pass_fits(frames: Tensor, state: MotionState | None, backend: Backend, *learned: Tensor) -> bool:
    """Whether frames `[T, 3, H, W]` and the state after the frame before them can go to the kernels."""
    if frames.ndim != 4 or frames.dtype not in KINDS:
        return False
    if not kernels_wanted(frames, *(state or ()), *learned, backend=backend):
        return False
    return state is None or all(s.shape == frames.shape[-2:] and s.dtype == image_kind(frames) for s in state)


def image_kind(frames: Tensor) -> torch.dtype:
    """Precision of the grey images of frames."""
    return torch.float64 if frames.dtype == torch.float64 else torch.float32


def pixels(frames: Tensor) -> tuple[Any, bool]:
    """Frames `[..., 3, H, W]` as an array without gaps, and whether colors lie beside each other: `[..., H, W, 3]`."""
    if frames.is_contiguous():
        return frames.numpy(), False
    last = frames.movedim(-3, -1)
    return (last.numpy(), True) if last.is_contiguous() else (frames.contiguous().numpy(), False)


def pass_over(
    frames: Tensor,
    state: MotionState | None,
    motion: HassensteinReichardt,
    thinning: Thinning,
    into: MotionState,
    sums: Any,
) -> Tensor:
    """Thinned grey images `[T, h, w]` of frames, and their motion and color sums.

    Args:
        frames: `[T, 3, H, W]`.
        state, into: before and after them; `into` is written, and may be `state`. None is settled on the first frame.
        motion: the detectors.
        thinning: what becomes of the grey images.
        sums: array that gets them, `[T, 7]` as of the kernel, and how many pixels are wrong.

    Raises:
        InputError: as `check_range`.
    """
    kind = np.float64 if frames.dtype == torch.float64 else np.float32
    images = np.empty((len(frames), *thinning.size), kind)
    if state is not None and state is not into:
        for part, before in zip(into, state, strict=True):
            part.copy_(before)
    slow, delayed = (part.numpy() for part in into)
    floats = frames.dtype != torch.uint8
    constants = PassConstants(
        float(motion.a_high),
        float(motion.a_low),
        motion.border == "wrap",
        thinning.blocks[0],
        thinning.margins,
        rows_apart(frames) if floats else 0,
    )
    unit = 1.0 if floats else 1 / 255
    front_end(*pixels(frames), unit, state is None, slow, delayed, constants, images, sums)
    if sums[:, -1].any():
        check_range(frames)
    return torch.from_numpy(images)


def together(thinning: Thinning, kind: torch.dtype) -> int:
    """How many thinned images are filtered at once: while they stay in the cache, calls cost less for each.

    In double precision one: some transforms of several are not the same to the bit as of one.
    """
    if kind == torch.float64:
        return 1
    return max(1, min(8, (1 << 17) // (thinning.size[0] * thinning.size[1])))


def fresh(frames: Tensor) -> MotionState:
    """Memory for the state after frames `[T, 3, H, W]`, without anything in it."""
    return MotionState(*(torch.empty(frames.shape[-2:], dtype=image_kind(frames)) for _ in range(2)))
