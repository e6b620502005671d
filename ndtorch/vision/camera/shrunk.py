"""A frame of a camera as the small picture on which figures are told from the ground."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ndtorch.errors import InputError
from ndtorch.kernels.apart_colors import apart_colors
from ndtorch.kernels.halved_colors import halved_colors
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.vision.camera.ground import Floats, room
from ndtorch.vision.frames import as_float


def shrunk(frame: Tensor, size: tuple[int, int]) -> Floats:
    """A frame `[3, H, W]` at that height and width, `[3, h, w]`, 0..1; colors may lie beside each other in memory.

    Raises:
        InputError: for NaN and infinite values.
    """
    import cv2

    if frame.dtype != torch.uint8:
        frame = as_float(frame).float()
        if not torch.isfinite(frame.sum()):
            raise InputError("frames must be finite, got NaN or infinite values")
    small, planes = room(3, *size), frame.cpu().numpy()
    unit, beside = np.float32(1 / 255 if frame.dtype == torch.uint8 else 1), planes.transpose(1, 2, 0)
    if beside.flags.c_contiguous:
        height, width = size
        if planes.dtype == np.uint8 and planes.shape == (3, 2 * height, 2 * width) and kernels_wanted():
            halved_colors(beside.reshape(2 * height, -1), float(unit), small)
            return small
        image = np.asarray(cv2.resize(beside, size[::-1], interpolation=cv2.INTER_AREA))
        if kernels_wanted() and image.dtype == np.uint8:
            apart_colors(image, float(unit), small)
            return small
        parts = cv2.split(image)
    else:
        # Plane by plane: to lay colors beside each other costs more.
        parts = [cv2.resize(plane, size[::-1], interpolation=cv2.INTER_AREA) for plane in planes]
    for plane, to in zip(parts, small, strict=True):
        np.multiply(plane, unit, out=to)
    return small
