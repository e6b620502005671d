"""Overlapping receptive fields on a coarse grid: what a retinotopic glomerulus sums over."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.errors import InputError


def tents(length: int, fields: int) -> Tensor:
    """Weights of a line of pixels in overlapping fields, `[fields, length]`; each row sums to 1.

    Fields are as wide as two of their spacings and fall off linearly, so that something small that moves along
    leaves one as it enters the next. A single field weighs all pixels alike: the whole field of the papers.
    """
    if not 1 <= fields <= length:
        raise InputError(f"fields must be between 1 and the {length} pixels of a side, got {fields}")
    if fields == 1:
        return torch.full((1, length), 1 / length)
    spacing = length / fields
    centers = (torch.arange(fields) + 0.5) * spacing
    weights = (1 - (torch.arange(length) + 0.5 - centers[:, None]).abs() / spacing).clamp_min(0)
    return weights / weights.sum(1, keepdim=True)


def pool(images: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """Means over fields, `[..., H, W]` -> `[..., R, C]`, with weights `[R, H]` and `[C, W]` from `tents`."""
    return rows @ images @ columns.mT
