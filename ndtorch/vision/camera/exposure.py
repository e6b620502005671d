"""Exposure of a camera, told from the background: one gain a color and frame."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.vision.camera.sampling import every_other


def exposure_gain(frame: Tensor, background: Tensor, limit: float, darkest: float, lit: float) -> tuple[Tensor, Tensor]:
    """Gain of each color plane against a background: the median over pixels of their ratio.

    A median does not move while less than half of the picture is covered by something else. It takes out automatic
    exposure and white balance, the first cause of nonsense in sums over ordinary video: a bright object that enters
    moves all colors of the whole picture together.

    A gain beyond the limit is more than a camera's exposure does: most of the picture is another. So it is where
    something comes out of darkness, for in the dark there is nothing to compare with.

    Args:
        frame, background: `[..., C, H, W]`, 0..1.
        limit: largest gain, and 1 / the smallest.
        darkest: darker background than this says nothing about gain: noise and offsets rule there.
        lit: nor does a background of which less than this share is brighter.

    Returns:
        `[..., C, 1, 1]`, 1 where the background is too dark to tell; whether the picture is another, `[..., 1, 1, 1]`.
    """
    # Every fourth pixel tells as much.
    frame, background = every_other(frame), every_other(background)
    bright = background > darkest
    ratio = torch.where(bright, frame / background.clamp_min(darkest), torch.nan)
    gain = ratio.flatten(-2).nanmedian(-1).values
    # Half of the pixels are enough; a picture that is nearly all dark is left as it is.
    usable = share(bright) > lit
    gain = torch.where(usable, gain, torch.ones_like(gain))
    kept = gain.clamp(1 / limit, limit)
    other = (kept != gain).float().mean(-1) > 0.5
    dawn = ~usable.any(-1) & (share(frame > darkest) > lit).any(-1)
    return kept[..., None, None], (other | dawn)[..., None, None, None]


def share(where: Tensor) -> Tensor:
    """Share of a picture, `[..., H, W]` bool -> `[...]`."""
    return where.flatten(-2).float().mean(-1)
