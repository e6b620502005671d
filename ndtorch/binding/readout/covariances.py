"""Read-out of single objects: of each the strongest neuron, and what fluctuates with it.

Where one object dominates what is seen, it is known what the competitive rule converges to: the strongest neuron k
owns it, and its column of weights is `<h_n h_k>`, h being the high-passed signals through the settled first stage. So
nothing has to be learned over again for every object that comes into view.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.feedback import settled
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.owners import features_by_group
from ndtorch.vision.roots import root


def columns(covariances: Tensor, first_stage: Tensor) -> tuple[Tensor, Tensor]:
    """The strongest neuron and its column, int64 `[...]` and `[..., 10]`.

    Args:
        covariances: of the high-passed signals, `[..., 10, 10]`.
        first_stage: weights of the first stage, `[10, 10]`.
    """
    deviation = root(covariances.diagonal(dim1=-2, dim2=-1))
    # Motion is in other units than color: each group counts by its largest fluctuation.
    scale = spread_groups(group_max(deviation))
    first = settled(first_stage).to(covariances.dtype)
    shared = first @ divide(covariances, scale.unsqueeze(-1) * scale.unsqueeze(-2)) @ first.mT
    owner = shared.diagonal(dim1=-2, dim2=-1).argmax(-1)
    return owner, shared.gather(-1, owner[..., None, None].expand(*shared.shape[:-1], 1)).squeeze(-1)


def single_table(covariances: Tensor, there: Tensor, first_stage: Tensor, smallest: float = 1 / 3) -> ObjectTable:
    """The tables of single objects: one owner and one row in each, none where there is no object.

    Args:
        covariances: of the high-passed signals, `[..., 10, 10]`.
        there: whether there is an object, `[...]` bool.
        first_stage: weights of the first stage, `[10, 10]`.
        smallest: share of its group's largest that makes a feature.
    """
    owner, column = columns(covariances, first_stage)
    owners = torch.nn.functional.one_hot(owner, column.shape[-1]).bool() & there.unsqueeze(-1)
    return ObjectTable(
        owners, torch.where(owners.unsqueeze(-1), features_by_group(column, smallest).unsqueeze(-2), 0.0)
    )


def single_weights(covariances: Tensor, there: Tensor, first_stage: Tensor) -> Tensor:
    """Weights of single objects, `[..., 10, 10]`: the owner's column relative to the owner; zero elsewhere.

    Arguments as `single_table`.
    """
    owner, column = columns(covariances, first_stage)
    own = column.gather(-1, owner.unsqueeze(-1))
    # Where nothing fluctuates there is nothing to divide by.
    there = there.unsqueeze(-1) & (own > 0)
    share = torch.where(there, column / torch.where(there, own, 1.0), 0.0)
    here = torch.nn.functional.one_hot(owner, column.shape[-1]).to(column.dtype)
    apart = 1 - torch.eye(column.shape[-1], dtype=column.dtype, device=column.device)
    return share.unsqueeze(-1) * here.unsqueeze(-2) * apart
