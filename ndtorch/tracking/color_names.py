"""Achromatic colors: how much of a track is white, grey, black or colored, under the white balance of the scene."""

from __future__ import annotations

import numpy as np

from ndtorch.config import Constants, Shares, constant
from ndtorch.foreground.arrays import Floats, Numbers
from ndtorch.tracking._kernels_tracks import WhiteBalanceNumbers, measure_white_balance

SHADES = ("white", "grey", "black")
"""Colors without a hue, in the order used everywhere."""
DIMMEST = 0.02
"""Smallest mean of a color from which the white balance is measured."""


class ColorParams(Constants):
    """Where hue, white and black begin and end; brightness is a fraction of the brightest patch in view."""

    min_hue: float = constant(0.02, "A hue below this fraction of full scale is achromatic.", gt=0)
    min_hue_ratio: float = constant(0.12, "A hue below this fraction of the brightness is achromatic.", ge=0)
    white_ratio: Shares = constant((0.5, 0.7), "White begins between these fractions of the brightest patch.")
    black_ratio: Shares = constant((0.12, 0.25), "Black ends between these fractions of the brightest patch.")


class WhiteBalance:
    """Gains under which the background is grey on average, and the brightest patch, which looks white.

    Args:
        image, background: `[3, h, w]`, 0..1.
    """

    def __init__(self, image: Floats, background: Floats, params: ColorParams) -> None:
        self.gains = np.empty(3, np.float32)
        self.brightest = max(measure_white_balance(image, background, DIMMEST, self.gains), DIMMEST)
        self.params = params

    def numbers(self) -> WhiteBalanceNumbers:
        """For compiled functions."""
        p = self.params
        red, green, blue = self.gains.tolist()
        return WhiteBalanceNumbers(
            (red, green, blue), float(self.brightest), p.min_hue, p.min_hue_ratio, p.white_ratio, p.black_ratio
        )


def achromatic_name(shares: Numbers) -> str | None:
    """White, grey or black if less than half has a hue, `[4]`; None otherwise."""
    return None if 2 * shares[3] >= shares.sum() else SHADES[int(shares[:3].argmax())]
