"""Owners of features in the learned weights. [C §4.1]"""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.arguments import check_tensor
from ndtorch.binding.normalise import group_max, over_groups
from ndtorch.binding.objects import ObjectTable
from ndtorch.errors import InputError


def features_by_group(values: Tensor, smallest: float = 1 / 3) -> Tensor:
    """Each group of features over its own largest, negative and small ones removed, `[..., 10]`."""
    positive = values.clamp_min(0)
    shares = over_groups(positive, group_max(positive))
    return torch.where(shares >= smallest, shares, 0.0)


def strongest_columns(weights: Tensor, count: int) -> Tensor:
    """Columns of `[10, 10]` weights of the neurons that send most inhibition, with themselves, `[count, 10]`."""
    senders = weights.clamp_min(0).sum(-2).topk(count).indices
    return (weights.mT + torch.eye(10).to(weights))[senders]


SMALLEST_WEIGHT = 1 / 3
SMALLEST_COLUMN = 0.6


def simplified(weights: Tensor, smallest_weight: float = SMALLEST_WEIGHT) -> Tensor:
    """Weights `[..., N, N]` over the largest of them, those under `smallest_weight` removed. [C eq. 6-7]"""
    if weights.ndim < 2 or weights.shape[-1] != weights.shape[-2]:
        raise InputError(f"weights must be square matrices [..., N, N], got {tuple(weights.shape)}")
    largest = weights.amax((-1, -2), keepdim=True).clamp_min(torch.finfo(weights.dtype).tiny)
    normed = weights / largest
    return torch.where(normed >= smallest_weight, normed, 0.0)


def object_table(
    weights: Tensor, smallest_weight: float = SMALLEST_WEIGHT, smallest_column: float = SMALLEST_COLUMN
) -> ObjectTable:
    """Read the objects out of second-stage weights `[..., N, N]`. [C eq. 6-10]

    A neuron owns an object when the weights it sends, after normalisation to the largest weight and removal of
    those under `smallest_weight`, sum to more than `smallest_column`. All zero weights give no object.

    >>> weights = torch.zeros(10, 10)
    >>> weights[1, 7] = weights[4, 7] = 0.8  # from red to right and to 0°
    >>> object_table(weights).owners.nonzero().tolist()
    [[7]]
    """
    check_tensor("weights", weights)
    kept = simplified(weights, smallest_weight)
    owners = kept.sum(-2) > smallest_column
    own = torch.eye(weights.shape[-1], dtype=weights.dtype, device=weights.device)
    return ObjectTable(owners, torch.where(owners.unsqueeze(-1), kept.mT + own, 0.0))
