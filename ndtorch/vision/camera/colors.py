"""Colors of what stands out: red, green and blue, or white, grey and black."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from ndtorch.vision.camera.params import CameraParams

SHADES = ("white", "grey", "black")
"""Colors without a hue, in the order used everywhere."""


def balanced(frame: Tensor, background: Tensor, params: CameraParams) -> Tensor:
    """The frame `[3, h, w]` under light in which the background is grey on average."""
    white = background.mean((-1, -2), keepdim=True).clamp_min(params.dimmest_white)
    return frame * (white.mean() / white)


def hues_and_shades(frame: Tensor, background: Tensor, params: CameraParams) -> tuple[Tensor, Tensor]:
    """Hues of every pixel, `[3, h, w]`, and white, grey and black, then how sure its hue is, `[4, h, w]`, one in sum.

    The colors of a pixel inhibit one another, and what is left is its hue. Where that is little, by itself or beside
    the pixel's brightness, it is rounding, a sensor's noise or light with a tint: the pixel has a shade instead, by its
    brightness against the brightest that is in the picture or in its background (what is brightest looks white).

    Args:
        frame, background: `[3, h, w]`, 0..1.
        params: where white, black and pale begin and end.
    """
    p = params
    color = balanced(frame, background, p)
    bright = color.mean(0)
    hue = (color - bright).clamp_min(0)
    pale = (p.pale * bright).clamp_min(p.palest)
    share = (hue.amax(0) / pale - 1).clamp(0, 1)
    both = torch.stack([bright, balanced(background, background, p).mean(0)])
    light = bright / F.avg_pool2d(both, 4).amax().clamp_min(p.dimmest_white)
    white = ((light - p.white[0]) / (p.white[1] - p.white[0])).clamp(0, 1)
    black = ((p.black[1] - light) / (p.black[1] - p.black[0])).clamp(0, 1)
    shades = torch.stack([white, 1 - white - black, black]) * (1 - share)
    return hue, torch.cat([shades, share.unsqueeze(0)])
