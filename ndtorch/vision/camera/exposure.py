"""Exposure of a camera, told from the background: one gain a colour and frame."""

from __future__ import annotations

import torch
from torch import Tensor


def exposure_gain(frame: Tensor, background: Tensor, limit: float, darkest: float, lit: float) -> Tensor:
    """Gain of each colour plane against a background: the median over pixels of their ratio.

    A median does not move while less than half of the picture is covered by something else. It takes out automatic
    exposure and white balance, the first cause of nonsense in sums over ordinary video: a bright object that enters
    moves all colours of the whole picture together.

    Args:
        frame, background: `[..., C, H, W]`, 0..1.
        limit: largest gain, and 1 / the smallest.
        darkest: darker background than this says nothing about gain: noise and offsets rule there.
        lit: nor does a background of which less than this share is brighter.

    Returns:
        `[..., C, 1, 1]`; 1 where the background is too dark to tell.
    """
    # Every fourth pixel tells as much.
    frame, background = frame[..., ::2, ::2], background[..., ::2, ::2]
    bright = background > darkest
    ratio = torch.where(bright, frame / background.clamp_min(darkest), torch.nan)
    gain = ratio.flatten(-2).nanmedian(-1).values
    # Half of the pixels are enough; a picture that is nearly all dark is left as it is.
    usable = bright.flatten(-2).float().mean(-1) > lit
    gain = torch.where(usable, gain, torch.ones_like(gain))
    return gain.clamp(1 / limit, limit)[..., None, None]
