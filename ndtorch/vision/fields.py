"""Overlapping receptive fields on a coarse grid: what a retinotopic glomerulus sums over."""

from __future__ import annotations

import math
from typing import Literal

import torch
from torch import Tensor

from ndtorch.arguments import check_tensor
from ndtorch.errors import InputError

Shape = Literal["cosine", "tent"]
Edge = Literal["wrap", "reflect", "open"]
SHAPES: tuple[Shape, ...] = ("cosine", "tent")
EDGES: tuple[Edge, ...] = ("wrap", "reflect", "open")


def field_weights(points: Tensor, length: float, fields: int, border: Edge = "wrap", shape: Shape = "cosine") -> Tensor:
    """How much each point of a line belongs to each of `fields` overlapping fields, `[fields, points]`.

    Fields are two spacings wide and centered on `(f + 1/2) length / fields`, so that something small that moves along
    leaves one as it enters the next. Between the first and the last center they add up to one, beyond them with
    "wrap" and "reflect". A single field weighs all points alike: the whole field of the papers.

    Args:
        points: positions `[points]`; pixel n covers n to n + 1.
        length: of the line, in the same unit.
        fields: how many.
        border: "wrap" for a line that is closed, "reflect" where the first and the last field keep what lies beyond
            their centers, "open" where they fall off there too.
        shape: raised "cosine", or a "tent" that falls off linearly.

    Raises:
        InputError: another shape or border, no field, more fields than pixels, or points other than finite numbers
            `[points]`.

    >>> weights = field_weights(torch.arange(100.0), 100.0, 5)
    >>> weights.shape, bool((weights.sum(0) - weights.sum(0).mean()).abs().max() < 1e-5)
    (torch.Size([5, 100]), True)
    """
    if shape not in SHAPES:
        raise InputError(f"shape must be one of {', '.join(SHAPES)}, got {shape!r}")
    if border not in EDGES:
        raise InputError(f"border must be one of {', '.join(EDGES)}, got {border!r}")
    if not 1 <= fields <= length:
        raise InputError(f"fields must be between 1 and the {length} pixels of a side, got {fields}")
    check_tensor("points", points)
    if points.ndim != 1:
        raise InputError(f"points must be [points], got {tuple(points.shape)}")
    if fields == 1:
        return torch.ones_like(points).unsqueeze(0)
    spacing = length / fields
    centers = (torch.arange(fields, dtype=points.dtype) + 0.5) * spacing
    offset = (points - centers[:, None]) / spacing
    if border == "wrap":
        offset = (offset + fields / 2) % fields - fields / 2
    elif border == "reflect":
        offset[0].clamp_(min=0)
        offset[-1].clamp_(max=0)
    away = offset.abs()
    if shape == "tent":
        return (1 - away).clamp_min(0)
    return torch.where(away < 1, 0.5 + 0.5 * torch.cos(math.pi * offset), 0.0)


def means(weights: Tensor) -> Tensor:
    """Weights of fields `[fields, points]` that sum to 1 in every field."""
    return weights / weights.sum(1, keepdim=True)


def pool(images: Tensor, rows: Tensor, columns: Tensor) -> Tensor:
    """Over fields, `[..., H, W]` -> `[..., R, C]`, with weights `[R, H]` and `[C, W]`: sums, or of `means` means."""
    return rows @ images @ columns.mT
