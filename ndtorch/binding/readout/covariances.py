"""Read-out of single objects: of each the strongest neuron, and what fluctuates with it.

Where one object dominates what is seen, it is known what the competitive rule converges to: the strongest neuron k
owns it, and its column of weights is `<h_n h_k>`, h being the high-passed signals through the settled first stage. So
nothing has to be learned over again for every object that comes into view.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.learning import settled
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.owners import features_by_group
from ndtorch.vision.features import GROUPS
from ndtorch.vision.temporal import safe_sqrt


def columns(covariances: Tensor, first_stage: Tensor) -> tuple[Tensor, Tensor]:
    """The strongest neuron `[...]`, int64, and its column `[..., 10]`, of covariances `[..., 10, 10]` of high-passed
    signals.
    """
    shared = refined(covariances, first_stage)
    owner = shared.diagonal(dim1=-2, dim2=-1).argmax(-1)
    return owner, column_of(shared, owner)


def refined(covariances: Tensor, first_stage: Tensor) -> Tensor:
    """Covariances of the signals through the settled first stage, `[..., 10, 10]`, each group over its largest."""
    deviation = safe_sqrt(covariances.diagonal(dim1=-2, dim2=-1))
    # Motion is in other units than color: each group counts by its largest fluctuation.
    scale = spread_groups(group_max(deviation))
    first = settled(first_stage).to(covariances.dtype)
    out: Tensor = first @ divide(covariances, scale.unsqueeze(-1) * scale.unsqueeze(-2)) @ first.mT
    return out


def column_of(matrix: Tensor, index: Tensor) -> Tensor:
    """One column of each matrix, `[..., 10, 10]` and int64 `[...]` -> `[..., 10]`."""
    return matrix.gather(-1, index[..., None, None].expand(*matrix.shape[:-1], 1)).squeeze(-1)


def by_groups(covariances: Tensor, first_stage: Tensor, apart: Tensor, agrees: float) -> tuple[Tensor, Tensor]:
    """As `columns`, but of objects `apart` `[...]` each group may speak for itself.

    Where a group's strongest neuron has a correlation below `agrees` with the owner, what the group has in the column
    is what fluctuates with that neuron instead. Before a ground that is light a thing that gets darker stands out
    again: motion and orientation go another way than color then, or none.
    """
    shared = refined(covariances, first_stage)
    power = shared.diagonal(dim1=-2, dim2=-1)
    owner = power.argmax(-1)
    column, parts = column_of(shared, owner), []
    for group in GROUPS.values():
        strongest = power[..., group].argmax(-1) + group.start
        both = power.gather(-1, owner.unsqueeze(-1)) * power.gather(-1, strongest.unsqueeze(-1))
        other = column.gather(-1, strongest.unsqueeze(-1)) < agrees * safe_sqrt(both.clamp_min(0))
        own = column_of(shared, strongest)[..., group]
        parts.append(torch.where(other & apart.unsqueeze(-1), own, column[..., group]))
    return owner, torch.cat(parts, -1)


def single_table(
    covariances: Tensor,
    there: Tensor,
    first_stage: Tensor,
    smallest: float = 1 / 3,
    apart: Tensor | None = None,
    agrees: float = 0.5,
) -> ObjectTable:
    """The tables of single objects: one owner and one row in each, none where there is no object.

    Covariances of the high-passed signals are `[..., 10, 10]`, `there` and `apart` are `[...]` bool; `smallest` is the
    share of its group's largest that makes a feature, `agrees` as in `by_groups`.
    """
    apart = torch.zeros_like(there) if apart is None else apart
    owner, column = by_groups(covariances, first_stage, apart, agrees)
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
