"""Checks and conversions at the edge of the front end: what counts as a frame."""

from __future__ import annotations

import ctypes
import functools
import itertools
import math
import sys
from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from ndtorch.arguments import USUAL, Function, check_dense, has_values
from ndtorch.errors import InputError
from ndtorch.utils.tensors import leaves, mapped

SLACK = 0.01
"""How far beyond 0..1 floats may lie: interpolation may go a little too far."""

LARGE = 1 << 18
"""Numbers of a trial from which on it is computed by itself: more leave the cache of a CPU."""

NEAR = 1e-4
"""How far from a whole number of 255 parts a float may lie that is one: some times its last digit."""


def check_frames(frames: Tensor, size: tuple[int, int] | None = None, device: torch.device | None = None) -> Tensor:
    """Return `frames` as `[..., T, 3, H, W]`, grey input replicated to three channels.

    Args:
        frames: `[..., T, C, H, W]` with C = 3 or 1; float32 or float64 in 0..1, or uint8. Half precision holds no
            picture to the last bit of uint8, and is refused.
        size: wanted height and width, or None for any.
        device: where they must be, that of the module's own tensors; None for anywhere.

    Raises:
        InputError: wrong type, number of dimensions, channel count or size, no frame at all, or floats that are not in
            0..1, such as those of 0..255, by a look at some rows where values can be looked at (`has_values`).
    """
    check_dense("frames", frames, meta=True)
    if device is not None and frames.device != device:
        raise InputError(f"frames must be on {device} as the module is, got {frames.device}")
    if frames.dtype != torch.uint8 and frames.dtype not in USUAL:
        raise InputError(f"frames must be float32 or float64 in 0..1, or uint8, got {frames.dtype}")
    if frames.ndim < 4:
        raise InputError(f"frames must have shape [..., T, C, H, W], got {tuple(frames.shape)}")
    channels, height, width = frames.shape[-3:]
    if channels not in (1, 3):
        hint = "; give frames.permute(0, 3, 1, 2)" if width in (1, 3) and frames.ndim == 4 else ""
        raise InputError(f"frames must have 3 channels (or 1, grey), got {channels}: {tuple(frames.shape)}{hint}")
    if frames.numel() == 0:
        raise InputError(f"frames must hold at least one frame, got {tuple(frames.shape)}")
    if size is not None and (height, width) != tuple(size):
        raise InputError(
            f"frames must be {size[0]}x{size[1]} pixels (height x width), got {height}x{width}; "
            f"set size=({height}, {width}) in the module or the config"
        )
    if frames.is_floating_point() and has_values(frames):
        low, high = torch.stack(torch.aminmax(some_rows(frames.detach()).contiguous())).tolist()
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError("frames must be finite, got NaN or infinite values")
        if not (low >= -SLACK and high <= 1 + SLACK):
            raise InputError(f"frames of floats must lie in 0..1, got {low:g} to {high:g}; give uint8 or divide by 255")
    return frames if channels == 3 else frames.expand(*frames.shape[:-3], 3, height, width)


def some_rows(frames: Tensor) -> Tensor:
    """Some 32 rows of every frame, for a quick look at its values."""
    return frames[..., :: max(1, frames.shape[-2] // 32), :]


def as_float(frames: Tensor) -> Tensor:
    """uint8 scaled to 0..1, float32; the rest as it is."""
    return frames.float().mul_(1 / 255) if frames.dtype == torch.uint8 else frames


def frames_in(frames: Tensor, dtype: torch.dtype) -> Tensor:
    """Frames in the type that a model computes in, so that a picture gives the same numbers in whatever type it comes.

    Floats that are pictures of 8 bits become uint8, since the first fluctuations are no larger than the last digits of
    what `1 / 255` makes of them. Frames that nothing can take are left to `check_frames`.
    """
    if isinstance(frames, Tensor) and frames.dtype == torch.uint8 and dtype == torch.float32:
        return frames
    usable = isinstance(frames, Tensor) and frames.layout == torch.strided and has_values(frames)
    if not usable or frames.dtype not in (*USUAL, torch.uint8):
        return frames
    if is_of_bytes(frames):
        frames = (frames * 255).round_().to(torch.uint8)
    if frames.dtype == torch.uint8:
        return frames if dtype == torch.float32 else frames.to(dtype) / 255
    return frames.to(dtype)


def is_of_bytes(frames: Tensor) -> bool:
    """Whether floats are n / 255 throughout, but for rounding."""
    if frames.dtype == torch.uint8 or frames.requires_grad or frames.ndim < 4 or not frames.numel():
        return False
    for some in (some_rows(frames[..., -1:, :, :, :]), some_rows(frames), frames):  # most others fail the first look
        levels = some * 255
        whole = levels.round()
        if not bool(((levels - whole).abs_() <= NEAR).all() and (whole >= 0).all() and (whole <= 255).all()):
            return False
    return True


def grey(frames: Tensor) -> Tensor:
    """Mean of the three color planes, `[..., 3, H, W]` -> `[..., H, W]`. [B §2.1]"""
    red, green, blue = frames.unbind(-3)
    # Three passes over planes: faster on a CPU than a mean over a strided dimension.
    return (red + green).add_(blue).mul_(1 / 3)


def trial_by_trial(*fewer: int) -> Callable[[Function], Function]:
    """Decorator of `forward(self, x, state)`: on a CPU, large trials of a batch are computed one after the other.

    Together, what is in between leaves the cache, and a pass over memory takes longer than what is computed.

    Args:
        fewer: how many dimensions each tensor of the state has less than x.
    """

    def decorate(forward: Function) -> Function:
        @functools.wraps(forward)
        def call(self: Any, x: Tensor, state: Any = None) -> Any:
            batch = x.shape[:-4] if isinstance(x, Tensor) else ()
            if not batch or not has_values(x) or not x.is_cpu or math.prod(x.shape[-4:]) < LARGE:
                return forward(self, x, state)
            shapes = [(part.shape[: len(batch)], part.ndim) for part in leaves(state).values()]
            if shapes and shapes != [(batch, x.ndim - less) for less in fewer]:  # it broadcasts
                return forward(self, x, state)
            return each_trial(functools.partial(forward, self), x, state, max(1, LARGE // math.prod(x.shape[-3:])))

        return call  # type: ignore[return-value]

    return decorate


def each_trial(step: Callable[[Tensor, Any], tuple[Tensor, Any]], x: Tensor, state: Any, length: int) -> Any:
    """Output and state of `step(x, state)` for one trial `[T, C, H, W]` after the other; without gradients, so many
    frames at once."""
    (*batch, steps), ends, rows, out = x.shape[:-3], [], list[Tensor](), None
    length = steps if torch.is_grad_enabled() else length
    for at in itertools.product(*map(range, batch)):
        end = mapped(state, lambda _, part, at=at: part[at])  # type: ignore[misc]
        for begin in range(0, steps, length):
            some, end = step(x[at][begin : begin + length], end)
            if torch.is_grad_enabled():
                rows.append(some)
                continue
            out = fresh((*batch, steps, *some.shape[1:]), some) if out is None else out
            out[at][begin : begin + length] = some
        ends.append(leaves(end))
    stacked = mapped(end, lambda name, one: torch.stack([flat[name] for flat in ends]).reshape(*batch, *one.shape))
    return torch.stack(rows).reshape(*batch, *rows[0].shape) if out is None else out, stacked


def fresh(shape: Sequence[int], like: Tensor) -> Tensor:
    """Memory for results. Of more than 32 MiB the C library asks the system: for large pages, where it is Linux, since
    a page fault for every 4 KiB takes longer than to fill them."""
    out = like.new_empty(shape)
    if out.nbytes > 32 << 20 and sys.platform == "linux":
        skipped = -out.data_ptr() % 4096
        advise = ctypes.CDLL(None).madvise
        advise(ctypes.c_void_p(out.data_ptr() + skipped), ctypes.c_size_t(out.nbytes - skipped), 14)
    return out
