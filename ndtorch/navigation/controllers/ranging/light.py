"""How much brighter the light is than a frame before: lamps that flicker are not motion."""

from __future__ import annotations

import torch
from torch import Tensor

SMALLEST = 0.01
"""Changes up to this share are left alone: as much comes from texture that moves past."""

LARGEST = 2.0
"""No lamp changes by more than this factor, or its inverse, from one frame to the next."""

DARK = 0.01
"""Means below this share of white say nothing of the light."""


def light_gain(now: Tensor, before: Tensor, bands: int, blocks: int) -> Tensor:
    """Brightness of a frame over that of the one before, 1 where it is the same.

    The cells of both eyes are compared with themselves, and their median counts. So what comes into view does not
    matter, as long as it fills less than half of the cells in one frame. One row of each cell is enough.

    Args:
        now, before: grey images of the cells `[..., 2, h, w]`.
        bands, blocks: cells in a column and in a row.

    Returns:
        `[...]`.
    """
    rows = slice(None, None, now.shape[-2] // bands)
    ours, theirs = (
        image[..., rows, :].unflatten(-1, (blocks, -1)).mean(-1).clamp(min=DARK).flatten(-3)  # type: ignore[no-untyped-call]
        for image in (now, before)
    )
    ratio = (ours / theirs).median(-1).values
    changed = ((ratio - 1.0).abs() > SMALLEST) & (ratio < LARGEST) & (ratio > 1 / LARGEST)
    return torch.where(changed, ratio, torch.ones_like(ratio))
