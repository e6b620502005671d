"""What has no hue: how much of a silhouette is white, grey, black, or colored."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from ndtorch.binding.tracking.figures import Numbers
from ndtorch.binding.tracking.regions import Floats
from ndtorch.config import Constants, Shares
from ndtorch.kernels.brightest import brightest as brightest_kernel
from ndtorch.kernels.switch import kernels_wanted

SHADES = ("white", "grey", "black")
"""Colors without a hue, in the order used everywhere."""
APART = 4
"""Every so many pixels of a silhouette are looked at; a patch of so many rows and columns may be the brightest."""


class ShadeParams(Constants):
    """Where a hue, white and black begin and end. Brightness is a share of the brightest patch in view."""

    palest: float = Field(0.02, gt=0, description="a hue of less than this is none: white, grey or black,")
    pale: float = Field(0.12, ge=0, description="nor is one of less than this share of the brightness")
    white: Shares = Field((0.5, 0.7), description="white is from here to there, of the brightest,")
    black: Shares = Field((0.12, 0.25), description="black below, and grey between")
    dimmest: float = Field(0.02, gt=0, description="smallest mean of a color that white is told from")


class Light:
    """The light of a scene: its tint, and what is brightest in it.

    Args:
        picture, ground: `[3, h, w]`, 0..1. In this light the ground is grey on average.
        params: constants.
    """

    def __init__(self, picture: Floats, ground: Floats, params: ShadeParams) -> None:
        import cv2

        self.params = p = params
        if kernels_wanted() and not any(side % APART for side in picture.shape[1:]):
            self.balance = np.empty(3, np.float32)
            self.brightest = max(brightest_kernel(picture, ground, APART, p.dimmest, self.balance), p.dimmest)
            return
        white = np.maximum(ground[:, ::APART, ::APART].mean((1, 2)), p.dimmest)
        self.balance = (white.mean() / white).astype(np.float32)
        size = (max(1, picture.shape[2] // APART), max(1, picture.shape[1] // APART))
        brightest = 0.0
        for image in (picture, ground):
            small = [np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA)) for plane in image]
            bright = np.tensordot(self.balance, np.stack(small), 1)
            brightest = max(brightest, float(bright.max() / 3))
        self.brightest = max(brightest, p.dimmest)

    def shares(self, colors: Floats) -> Numbers:
        """How much of some pixels `[3, n]` is white, grey, black, and colored, one in sum, `[4]`.

        A pixel's color is what its three inhibit not; where that is little it is noise, or light with a tint.
        """
        p = self.params
        color = colors[:, ::APART] * self.balance[:, None]
        bright = color.sum(0) / 3
        hue = np.clip((color.max(0) - bright) / np.maximum(p.pale * bright, p.palest) - 1, 0, 1)
        light = bright / self.brightest
        white = np.clip((light - p.white[0]) / (p.white[1] - p.white[0]), 0, 1)
        black = np.clip((p.black[1] - light) / (p.black[1] - p.black[0]), 0, 1)
        parts = np.stack([white * (1 - hue), (1 - white - black) * (1 - hue), black * (1 - hue), hue])
        return np.asarray(parts.mean(1), np.float64)


def shade_of(shares: Numbers) -> str | None:
    """White, grey or black, where less than half has a hue, `[4]`; None otherwise."""
    return None if 2 * shares[3] >= shares.sum() else SHADES[int(shares[:3].argmax())]
