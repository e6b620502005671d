"""The read-out that joins both ways to tell sources apart: by the network's owners, and by delays."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ndtorch.binding.feedback import settled
from ndtorch.binding.objects import ObjectTable
from ndtorch.binding.readout.delays import DelayState, Separation, separate
from ndtorch.binding.readout.owners import features_by_group


@dataclass(frozen=True)
class JoinCriteria:
    """When sources found by delays are believed.

    Attributes:
        smallest: share of the largest eigenvalue that a further source must have.
        gap: difference of delay profiles under which two sources are not told apart by delays.
        even: a source whose weakest colour is more than this share of its strongest, and its orientations likewise, is
            light that changes everywhere, if it
        moving: has less than this share of the largest motion.
    """

    smallest: float = 0.03
    gap: float = 0.02
    even: float = 0.65
    moving: float = 0.35


def refined_table(
    owners: ObjectTable, weights: Tensor, delays: DelayState, first_stage: Tensor, criteria: JoinCriteria | None = None
) -> ObjectTable:
    """The owners' table, or a better one from the delays where they tell the sources apart.

    The long memory is used, unless the short one says that fewer sources are left: then the scene has changed. The
    network's table stays where it finds nothing, where delays see a single source, and where two sources have the
    same delay profile (equal frequencies) and the network counts the same number.
    """
    c = criteria or JoinCriteria()
    slow, fast = (
        without_lighting(separate(covariances, c.smallest), first_stage, c)
        for covariances in (delays.slow, delays.fast)
    )
    changed = slow.sources > fast.sources
    mixing = torch.where(changed[..., None, None], fast.mixing, slow.mixing)
    count = torch.where(changed, fast.sources, slow.sources)
    gap = torch.where(changed, fast.gap, slow.gap)
    by_network = owners.owners.sum(-1)
    keep = (by_network == 0) | (count <= 1) | ((gap < c.gap) & (by_network == count))
    found = assigned(mixing, count, weights)
    return ObjectTable(
        torch.where(keep[..., None], owners.owners, found.owners),
        torch.where(keep[..., None, None], owners.rows, found.rows),
    )


def without_lighting(separation: Separation, first_stage: Tensor, criteria: JoinCriteria) -> Separation:
    """The same without sources that drive all colours and all orientations alike and hardly move."""
    mixing = separation.mixing
    eye = torch.eye(10, dtype=mixing.dtype, device=mixing.device)
    raw = mixing @ (eye + first_stage.to(mixing.dtype)).mT
    there = torch.arange(mixing.shape[-2], device=mixing.device) < separation.sources.unsqueeze(-1)
    even = there
    for group in (raw[..., 4:7], raw[..., 7:10]):
        even = even & (group.amin(-1) >= criteria.even * group.amax(-1))
    motion = mixing[..., :4].amax(-1).clamp_min(0)
    even = even & (motion < criteria.moving * motion.amax(-1, keepdim=True))
    # What is left moves to the front.
    order = torch.argsort((even | ~there).long(), dim=-1, stable=True)
    mixing = mixing.gather(-2, order.unsqueeze(-1).expand_as(mixing))
    sources = (there & ~even).sum(-1)
    rank = torch.arange(mixing.shape[-2], device=mixing.device)
    mixing = torch.where((rank < sources.unsqueeze(-1)).unsqueeze(-1), mixing, 0.0)
    return separation._replace(mixing=mixing, sources=sources)


def assigned(mixing: Tensor, count: Tensor, weights: Tensor) -> ObjectTable:
    """Give every source the neuron whose output is most purely that source, among the features it has.

    Shapes: mixing `[..., S, N]`, count `[...]`, weights T `[..., N, N]`.
    """
    rows = features_by_group(mixing)
    gain = (mixing @ settled(weights).mT).square()
    total = gain.sum(-2, keepdim=True).clamp_min(torch.finfo(gain.dtype).tiny)
    purity = torch.where(rows > 0, gain * gain / total, -1.0)
    owners = torch.zeros(*count.shape, mixing.shape[-1], dtype=torch.bool, device=mixing.device)
    out = torch.zeros_like(weights)
    for source in range(mixing.shape[-2]):
        score = purity[..., source, :].masked_fill(owners, -torch.inf)
        here = torch.nn.functional.one_hot(score.argmax(-1), mixing.shape[-1]).bool()
        here = here & (source < count).unsqueeze(-1)
        owners = owners | here
        out = torch.where(here.unsqueeze(-1), rows[..., source, :].unsqueeze(-2), out)
    return ObjectTable(owners, out)
