"""The ten features of receptive fields that have the shape of tracked objects."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from ndtorch.vision._kernels_masked import signals_of_sums, sum_features
from ndtorch.vision.motion import MotionState
from ndtorch.vision.orientation import OrientedDoG
from ndtorch.vision.temporal import smoothing_factor

Floats = npt.NDArray[np.float32]
Labels = npt.NDArray[np.int32]
Numbers = npt.NDArray[np.float64]

CENTER, SURROUND = (2.85, 0.9), (3.3, 1.35)
"""Deviations of the orientation filters in half the image's pixels: those published for 500 pixels, brought to 56."""
RADIUS = 11
"""The filters end so many pixels from their middle, where they are below 1/500 of their largest value."""
MAX_OBJECTS, TAU_HIGH, TAU_LOW = 32, 0.5, 0.05
"""Receptive fields at a time; high-pass and delay filter of the motion detectors, seconds."""
UNROLLED = 32
"""Loops over so many numbers at once have no rest."""


class Measured(NamedTuple):
    """Of one step: the largest difference from the background among the colors, `[h / 2, w / 2]`, and pixels, motion
    across and along, and red, green and blue of each field, `[MAX_OBJECTS, 6]` float64."""

    strongest: Floats
    sums: Numbers


class MaskedFeatures(nn.Module):
    """Ten signals of each mask: directed motion of what differs from the background, orientation, color.

    They are computed on an image of half the height and width and averaged over the mask of every track: a receptive
    field that forms where foreground is. Opponent motion is taken after averaging.

    Args:
        size: height and width of the image, multiples of 4.
        dt: seconds between images.
    """

    def __init__(self, size: tuple[int, int], dt: float) -> None:
        super().__init__()
        self.size = (size[0] // 2, size[1] // 2)
        self.filters = oriented_filters()
        self.shares = smoothing_factor(TAU_HIGH, dt), smoothing_factor(TAU_LOW, dt)

    def start(self, image: Floats, background: Floats, labels: Labels) -> MotionState:
        """Settled on the first image, as arrays."""
        apart = (image - background) * (labels > 0)
        pairs = apart[..., ::2] + apart[..., 1::2]
        halved = (pairs[:, ::2] + pairs[:, 1::2]) / 4
        return MotionState(halved, np.zeros_like(halved))  # type: ignore[arg-type]

    def measure(self, image: Floats, background: Floats, labels: Labels, state: MotionState) -> Measured:
        """The first part of a step, which goes on from the state before; the state's arrays are updated.

        Args:
            image, background: `[3, h, w]`.
            labels: number of the track of every pixel plus one, 0 for none, `[h, w]`.
        """
        strongest, sums = np.empty(self.size, np.float32), np.empty((MAX_OBJECTS, 6))
        sum_features(image, background, labels, *state, self.shares, strongest, sums)
        return Measured(strongest, sums)

    def signals(self, measured: Sequence[Measured | None], labels: Sequence[Labels]) -> Tensor:
        """The second part of T steps, `[T, MAX_OBJECTS, 10]`: of track n in row n % MAX_OBJECTS, zero elsewhere."""
        import cv2

        signals = torch.zeros(len(measured), MAX_OBJECTS, 10)
        for one, names, out in zip(measured, labels, signals.numpy(), strict=True):
            if one is not None and one.sums[:, 0].any():
                shown = np.asarray(cv2.copyMakeBorder(one.strongest, *4 * (RADIUS,), cv2.BORDER_REFLECT_101))
                signals_of_sums(shown, self.filters, names, one.sums, out)
        return signals


@cache
def oriented_filters() -> Floats:
    """The filters of three orientations, column after column, and again for each row at which they may begin.

    A mask is small: products at its pixels alone take a fraction of the time of a transform of the image.

    Returns:
        `[rows, 3, n]`, with zeros up to n.
    """
    side = 2 * RADIUS + 1
    impulse = torch.zeros(1, 2 * side, 2 * side)
    impulse[0, RADIUS, RADIUS] = 1
    response = OrientedDoG((2 * side, 2 * side), center=CENTER, surround=SURROUND, exact=True).images(impulse)[0]
    filters = np.zeros((side, 3, -(-side * side // UNROLLED) * UNROLLED), np.float32)
    for first in range(side):
        turned = response[:, :side, :side].roll(first, 1)
        filters[first, :, : side * side] = turned.transpose(1, 2).reshape(3, -1)
    return filters
