"""A camera's frame at the size at which its foreground is segmented."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.foreground.arrays import Array, Floats, aligned
from ndtorch.utils.jit import jit


def downscale(frame: Tensor, size: tuple[int, int]) -> Floats:
    """A frame `[3, H, W]` averaged to that height and width, `[3, h, w]`, 0..1; colors may be interleaved in memory.

    Floats are rounded to the 256 levels of uint8: a picture gives the same numbers in whatever type it comes.

    Raises:
        InputError: for NaN and infinite values.
    """
    import cv2

    if frame.dtype != torch.uint8:
        if not torch.isfinite(frame.sum()):
            raise InputError("frames must be finite, got NaN or infinite values")
        frame = (frame * 255).round_().clamp_(0, 255).to(torch.uint8)
    small, planes, (height, width) = aligned(3, *size), frame.detach().cpu().numpy(), size
    interleaved = planes.transpose(1, 2, 0)
    if not interleaved.flags.c_contiguous:
        # Plane by plane: interleaving the colors costs more.
        for plane, to in zip(planes, small, strict=True):
            resized = cv2.resize(plane, size[::-1], interpolation=cv2.INTER_AREA)
            np.multiply(resized, np.float32(1 / 255), out=to)
    elif planes.shape == (3, 2 * height, 2 * width):
        halve(interleaved.reshape(2 * height, -1), small)
    else:
        image = np.asarray(cv2.resize(interleaved, size[::-1], interpolation=cv2.INTER_AREA))
        split(image, small)
    return small


@jit
def split(image: Array, planes: Array) -> None:
    """Interleaved bytes `[h, w, 3]` as planes `[3, h, w]` of fractions of full scale."""
    _, height, width = planes.shape
    one = np.float32(1 / 255)
    for y in range(height):
        row, red, green, blue = image[y], planes[0, y], planes[1, y], planes[2, y]
        for x in range(width):
            red[x] = np.float32(row[x, 0]) * one
            green[x] = np.float32(row[x, 1]) * one
            blue[x] = np.float32(row[x, 2]) * one


@jit
def halve(image: Array, planes: Array) -> None:
    """Interleaved bytes `[2 h, 2 w * 3]` averaged in whole numbers, as `cv2.resize` does, to planes `[3, h, w]`."""
    sums = np.empty(image.shape[1], np.int32)
    for y in range(planes.shape[1]):
        add_rows(image[2 * y], image[2 * y + 1], sums)
        average_pairs(sums, planes[0, y], planes[1, y], planes[2, y])


@jit
def add_rows(upper: Array, lower: Array, sums: Array) -> None:
    for n in range(sums.shape[0]):
        sums[n] = np.int32(upper[n]) + np.int32(lower[n])


@jit
def average_pairs(sums: Array, red: Array, green: Array, blue: Array) -> None:
    """Means of pairs of neighbours as fractions of full scale; halves are rounded up."""
    one, half, quarter = np.float32(1 / 255), np.int32(2), np.int32(2)
    for x in range(red.shape[0]):
        k = 6 * x
        red[x] = np.float32((sums[k] + sums[k + 3] + half) >> quarter) * one
        green[x] = np.float32((sums[k + 1] + sums[k + 4] + half) >> quarter) * one
        blue[x] = np.float32((sums[k + 2] + sums[k + 5] + half) >> quarter) * one
