"""Names of colors under the light of the scene."""

from __future__ import annotations

import colorsys

import numpy as np

from ndtorch.foreground.background import Floats, Numbers

MIN_HUE, MIN_HUE_RATIO = 0.02, 0.12
"""A hue below this (of full scale), or below this share of the brightness, is none."""
WHITE, BLACK = 0.7, 0.25
"""White begins and black ends at these shares of the brightest patch in view."""
PATCH_PX, DIMMEST = 4, 0.02
"""Side of the patches of which the brightest looks white, and the smallest mean of a color."""
HUES = "red", "yellow", "green", "cyan", "blue", "magenta"
"""Names of hues 60° apart."""


def color_name(color: Numbers, background: Floats) -> str:
    """The nearest of `HUES`, white, grey or black of a mean color `[3]` before a background `[3, h, w]`.

    The light is that under which the background is grey in the mean.
    """
    import cv2

    means = background.reshape(3, -1).mean(1).clip(DIMMEST)
    balance = means.mean() / means
    red, green, blue = color * balance
    bright = (red + green + blue) / 3
    if max(red, green, blue) - bright > max(MIN_HUE_RATIO * bright, MIN_HUE):
        return HUES[round(6 * colorsys.rgb_to_hsv(red, green, blue)[0]) % 6]
    height, width = (max(1, side // PATCH_PX) for side in background.shape[1:])
    grey = (background * balance[:, None, None]).mean(0).astype(np.float32)
    brightest = max(float(cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA).max()), bright, DIMMEST)
    return "white" if bright > WHITE * brightest else "black" if bright < BLACK * brightest else "grey"
