"""The few pixels that navigation reads: cutting them out of two frames and making them grey."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.arguments import check_dense, is_whole
from ndtorch.errors import InputError
from ndtorch.navigation.stereo._kernels import Frames
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch.vision.temporal import time_dim


class Strips(NamedTuple):
    """What navigation reads of one camera's frames, for instance cut out next to the camera.

    Attributes:
        field: the subfield, `[..., T, C, h, w]`, uint8 or float in 0..1, C = 3 (RGB) or 1 (grey).
        row: the horizon row, `[..., T, C, 1, W]`, or an odd number of rows with it in the middle.
    """

    field: Tensor
    row: Tensor


def strips(eye: Tensor | Strips) -> Strips:
    """Whole frames stand for both of their strips: each step cuts its own."""
    return eye if isinstance(eye, Strips) else Strips(eye, eye)


def cut_strips(frames: Tensor, field: Rect, rig: StereoRig, rows: int = 1) -> Strips:
    """The subfield and the horizon row, or rows, of one camera's frames `[..., T, C, H, W]`, as views.

    >>> from ndtorch.navigation import StereoRig
    >>> rig = StereoRig()
    >>> strips = cut_strips(torch.zeros(1, 3, 480, 640), rig.subfields()[0], rig)
    >>> strips.row.shape
    torch.Size([1, 3, 1, 640])
    """
    return Strips(cut(frames, field), cut(frames, row_rect(rig, rows)))


def row_rect(rig: StereoRig, rows: int = 1) -> Rect:
    """The horizon row as a rectangle, or an odd number of rows with it in the middle.

    Raises:
        InputError: rows beyond the border of the frame.
    """
    if not (is_whole(rows) and rows >= 1):
        raise InputError(f"rows must be a whole number of at least 1, got {rows}")
    top, bottom = rig.row - rows // 2, rig.row + rows // 2 + 1
    if top < 0 or bottom > rig.height:
        raise InputError(f"{rows} rows around the horizon, row {rig.row}, leave frames of {rig.height} rows")
    return Rect(top, bottom, 0, rig.width)


def cut(frames: Tensor, rect: Rect) -> Tensor:
    """The pixels of a rectangle, a view."""
    rows = frames.narrow(-2, rect.top, rect.bottom - rect.top)
    return rows.narrow(-1, rect.left, rect.right - rect.left)


def check_eyes(left: Tensor, right: Tensor) -> None:
    """Raise `InputError` unless both are tensors that hold numbers, before anything is read of them."""
    check_dense("left", left)
    check_dense("right", right)


def grey_pair(
    left: Tensor, right: Tensor, left_rect: Rect, right_rect: Rect, size: tuple[int, int], every: int = 1
) -> Tensor:
    """Grey intensities in 0..1 of one rectangle of each image, `[..., T, 2, h, w]`, left first.

    Args:
        left, right: frames `[..., T, C, H, W]`, uint8 or float in 0..1, C = 3 (mean of RGB) or 1, either
            whole (of `size` H, W) or already cut to the rectangles, which are of one size.
        every: take only every so many columns.

    Raises:
        InputError: frames that differ in shape or type, or of another size, type or number of channels.
    """
    if left.shape != right.shape or left.dtype != right.dtype:
        raise InputError(
            f"left and right frames must be alike, got {left.dtype} {tuple(left.shape)} "
            f"and {right.dtype} {tuple(right.shape)}"
        )
    time_dim(left, 3, "left")
    channels, given = left.shape[-3], tuple(left.shape[-2:])
    cut_size = (left_rect.bottom - left_rect.top, left_rect.right - left_rect.left)
    if channels not in (1, 3) or given not in (size, cut_size):
        raise InputError(
            f"expected frames [..., T, C, H, W] with C = 1 or 3 and H, W = {size} or cut to {cut_size}, "
            f"got {tuple(left.shape)}"
        )
    if given == size:
        left, right = cut(left, left_rect), cut(right, right_rect)
    if every > 1:
        left, right = left[..., ::every], right[..., ::every]
    pair = torch.stack((left, right), -4)
    if pair.dtype == torch.uint8:
        return pair.sum(-3, dtype=torch.float32) * (1 / (255 * channels))
    if not pair.is_floating_point():
        raise InputError(f"left and right frames must be uint8 or floating point in 0..1, got {pair.dtype}")
    return pair.mean(-3)


def check_unit_range(motion: Tensor, frames: Tensor) -> None:
    """Raise `InputError` where floating point frames held NaN, infinity or numbers far beyond 0..1.

    Looking at the few maxima `motion` of the raw high-passed frames instead of at the pixels costs little:
    they are NaN or infinite when a pixel is, and at most 1 where all pixels are in 0..1.
    """
    if frames.is_floating_point() and not bool((motion <= 2.0).all()):
        raise InputError(
            f"floating point frames must hold finite numbers in 0..1, got changes of up to {float(motion.max())}"
        )


def check_peak(peak: float) -> None:
    """`check_unit_range` of a compiled step, which returns the largest change, or NaN where there was one."""
    if not peak <= 2.0:
        raise InputError(f"floating point frames must hold finite numbers in 0..1, got changes of up to {peak}")


def as_frames(left: Tensor, right: Tensor) -> Frames:
    """One frame of each camera, `[C, H, W]`, whole or cut, for compiled steps; nothing is copied.

    Raises:
        InputError: frames that are not alike, not on the CPU, with gradients, or of another type or number of colors.
    """
    try:
        shape, kind = left.shape, left.dtype
        alike = shape == right.shape and kind is right.dtype
    except AttributeError:
        check_eyes(left, right)
        raise
    if not alike:
        raise InputError(
            f"left and right frames must be alike, got {kind} {tuple(shape)} and {right.dtype} {tuple(right.shape)}"
        )
    if len(shape) != 3 or shape[0] not in (1, 3):
        raise InputError(f"expected frames [C, H, W] with C = 1 or 3, got {tuple(shape)}")
    if kind is torch.uint8:
        scale = UINT8_SCALE
    elif kind in (torch.float32, torch.float64, torch.float16, torch.bfloat16):
        scale = 1 / 3
        if kind.itemsize == 2:
            left, right = left.float(), right.float()
    else:
        raise InputError(f"left and right frames must be uint8 or floating point in 0..1, got {kind}")
    try:
        ours, theirs = left.numpy(), right.numpy()
    except (RuntimeError, TypeError):
        raise InputError(
            "compiled steps take frames on the CPU and give no gradients; choose backend='torch' for either"
        ) from None
    if left.is_contiguous() and right.is_contiguous():
        return Frames(ours, theirs, False, scale, (0, 0), (0, 0))
    ours, theirs = ours.transpose(1, 2, 0), theirs.transpose(1, 2, 0)
    if ours.flags.c_contiguous and theirs.flags.c_contiguous:
        return Frames(ours, theirs, True, scale, (0, 0), (0, 0))
    ours, theirs = (np.ascontiguousarray(eye.transpose(2, 0, 1)) for eye in (ours, theirs))
    return Frames(ours, theirs, False, scale, (0, 0), (0, 0))


UINT8_SCALE = 1 / 765
"""Of the sum of three bytes."""


def array_frames(left: Any, right: Any, size: tuple[int, int]) -> Frames:
    """`as_frames` of uint8 arrays `[H, W, C]` or `[C, H, W]`.

    Raises:
        InputError: arrays of another shape or type.
    """
    shape = left.shape
    if len(shape) != 3 or right.shape != shape or not left.dtype == right.dtype == np.uint8:
        raise InputError(f"left and right must be uint8 frames alike, got {left.dtype} {shape} and {right.shape}")
    interleaved = shape[:2] == size
    if (shape[2] if interleaved else shape[0]) not in (1, 3) or (not interleaved and shape[1:] != size):
        raise InputError(f"frames must be [H, W, C] or [C, H, W] with H, W = {size}, got {shape}")
    if not (left.flags.c_contiguous and right.flags.c_contiguous):
        left, right = np.ascontiguousarray(left), np.ascontiguousarray(right)
    return Frames(left, right, interleaved, UINT8_SCALE, (0, 0), (0, 0))


def at_rects(frames: Frames, rects: tuple[Rect, Rect], size: tuple[int, int]) -> Frames:
    """The same frames, whole or cut, with the places where the rectangles begin.

    Raises:
        InputError: frames that are neither of `size` nor of that of the rectangles.
    """
    shape = frames.left.shape[:2] if frames.interleaved else frames.left.shape[1:]
    (top, bottom, left, end), other = rects
    if shape == size:
        return Frames(*frames[:4], (top, other.top), (left, other.left))
    if shape != (bottom - top, end - left):
        raise InputError(
            f"expected frames [..., T, C, H, W] with C = 1 or 3 and H, W = {size} or cut to "
            f"{(bottom - top, end - left)}, got {frames.left.shape}"
        )
    return frames


def checked(low: Any, shape: tuple[int, ...]) -> Any:
    """A state of filters that compiled steps can go on from: compiled code does not look at sizes.

    Raises:
        InputError: it is none.
    """
    if not isinstance(low, np.ndarray) or low.shape != shape or low.dtype != np.float32:
        raise InputError(f"state.low of the filters must be float32 {list(shape)}, got {describe(low)}")
    return low


def describe(value: Any) -> str:
    shape = getattr(value, "shape", None)
    return type(value).__name__ if shape is None else f"{value.dtype} {list(shape)}"
