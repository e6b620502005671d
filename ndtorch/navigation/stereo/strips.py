"""The few pixels that navigation reads: cutting them out of two frames and making them grey."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.navigation.stereo._kernels import Frames
from ndtorch.navigation.stereo.rig import Rect, StereoRig


class Strips(NamedTuple):
    """What navigation reads of one camera's frames, for instance cut out next to the camera.

    Attributes:
        field: the subfield, `[..., T, C, h, w]`, uint8 or float in 0..1, C = 3 (RGB) or 1 (grey).
        row: the horizon row, `[..., T, C, 1, W]`, or an odd number of rows with it in the middle.
    """

    field: Tensor
    row: Tensor


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
    """The horizon row as a rectangle, or an odd number of rows with it in the middle, within the frame."""
    top, bottom = rig.row - rows // 2, rig.row + rows // 2 + 1
    if rows < 1 or top < 0 or bottom > rig.height:
        raise InputError(f"{rows} rows around the horizon, row {rig.row}, leave frames of {rig.height} rows")
    return Rect(top, bottom, 0, rig.width)


def cut(frames: Tensor, rect: Rect) -> Tensor:
    return frames[..., rect.top : rect.bottom, rect.left : rect.right]


def grey_pair(left: Tensor, right: Tensor, left_rect: Rect, right_rect: Rect, size: tuple[int, int]) -> Tensor:
    """Grey intensities in 0..1 of one rectangle of each image, `[..., T, 2, h, w]`, left first.

    Args:
        left, right: frames `[..., T, C, H, W]`, uint8 or float in 0..1, C = 3 (mean of RGB) or 1, either
            whole (of `size` H, W) or already cut to the rectangles, which are of one size.

    Raises:
        InputError: frames that differ in shape or type, or of another size, type or number of channels.
    """
    check_alike(left, right)
    if left.ndim < 4 or left.shape[-4] == 0:
        raise InputError(f"left must be frames [..., T >= 1, C, H, W], got {tuple(left.shape)}")
    cut_size = left_rect.size
    if left.shape[-3] not in (1, 3) or left.shape[-2:] not in (size, cut_size):
        raise wrong_size(size, cut_size, left.shape)
    if left.shape[-2:] == size:
        left, right = cut(left, left_rect), cut(right, right_rect)
    pair = torch.stack((left, right), -4)
    if pair.dtype == torch.uint8:
        return pair.sum(-3, dtype=torch.float32) * (1 / (255 * pair.shape[-3]))
    return pair.mean(-3)


def check_alike(left: Any, right: Any) -> None:
    if not (isinstance(left, Tensor) and isinstance(right, Tensor)):
        raise InputError(f"left and right must be tensors, got {type(left).__name__} and {type(right).__name__}")
    if left.shape != right.shape or left.dtype != right.dtype:
        raise InputError(
            f"left and right frames must be alike, got {left.dtype} {tuple(left.shape)} "
            f"and {right.dtype} {tuple(right.shape)}"
        )
    if left.dtype != torch.uint8 and not left.is_floating_point():
        raise InputError(f"left and right frames must be uint8 or floating point in 0..1, got {left.dtype}")


def wrong_size(size: tuple[int, int], cut_size: tuple[int, int], shape: Any) -> InputError:
    return InputError(
        f"expected frames [..., T, C, H, W] with C = 1 or 3 and H, W = {size} or cut to {cut_size}, got {tuple(shape)}"
    )


def check_peak(peak: Any, frames: Tensor | None = None) -> None:
    """Raise `InputError` where floating point frames held NaN, infinity or numbers far beyond 0..1.

    Args:
        peak: the largest change, a number, or maxima; compiled steps return NaN where there was a NaN or infinity.
        frames: of which maxima are; whole numbers need no look.
    """
    if frames is not None:
        peak = float(peak.detach().max()) if frames.is_floating_point() else 0.0
    if not peak <= 2.0:
        raise InputError(f"floating point frames must hold finite numbers in 0..1, got changes of up to {peak}")


def as_frames(left: Tensor, right: Tensor) -> Frames:
    """One frame of each camera, `[C, H, W]`, whole or cut, for compiled steps; nothing is copied."""
    check_alike(left, right)
    if left.ndim != 3 or left.shape[0] not in (1, 3):
        raise InputError(f"expected frames [C, H, W] with C = 1 or 3, got {tuple(left.shape)}")
    if left.requires_grad or left.device.type != "cpu":
        raise InputError("compiled steps take frames on the CPU and give no gradients; choose backend='torch' for both")
    if left.dtype in (torch.float16, torch.bfloat16):
        left, right = left.float(), right.float()
    scale, one, other = 1 / 765 if left.dtype == torch.uint8 else 1 / 3, left.numpy(), right.numpy()
    if not (one.flags.c_contiguous and other.flags.c_contiguous):
        one, other = one.transpose(1, 2, 0), other.transpose(1, 2, 0)
        if one.flags.c_contiguous and other.flags.c_contiguous:
            return Frames(one, other, True, scale, (0, 0), (0, 0))
        one, other = (np.ascontiguousarray(eye.transpose(2, 0, 1)) for eye in (one, other))
    return Frames(one, other, False, scale, (0, 0), (0, 0))


def at_rects(frames: Frames, rects: tuple[Rect, Rect], size: tuple[int, int]) -> Frames:
    """The same frames, whole, of `size`, or cut, with the places where the rectangles begin."""
    shape = frames.left.shape[:2] if frames.interleaved else frames.left.shape[1:]
    one, other = rects
    if shape == size:
        return Frames(*frames[:4], (one.top, other.top), (one.left, other.left))
    if shape != one.size:
        raise wrong_size(size, one.size, frames.left.shape)
    return frames


def checked(low: Any, shape: tuple[int, ...]) -> Any:
    """A state of filters that compiled steps can go on from: compiled code does not look at sizes."""
    if not isinstance(low, np.ndarray) or low.shape != shape or low.dtype != np.float32:
        kind = getattr(low, "dtype", type(low).__name__)
        raise InputError(f"state of the filters must be float32 {list(shape)}, got {kind} {np.shape(low)}")
    return low
