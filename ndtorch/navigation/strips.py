"""The few pixels that navigation reads: cutting them out of two frames and making them grey."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from ndtorch.arguments import check_dense
from ndtorch.errors import InputError
from ndtorch.navigation.rig import Rect, StereoRig
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
