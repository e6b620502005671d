"""The long memory of the sums without the seconds in which bars come near each other.

The sum of colors is exact: where one bar covers another, what is missing has the color of the covered one. Orientation
is not: it is the size of what wide filters give, and the size of a sum is not the sum of sizes. So while bars pass each
other, orientations go a way that no color goes, and that is none of the sources'. It passes within a second or three,
where a source that only orientations show stays.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.binding.covariance import CovarianceState
from ndtorch.binding.normalise import divide, group_max, spread_groups
from ndtorch.binding.readout.params import SumCriteria
from ndtorch.vision.features import GROUPS

ROUNDS = 6
"""What is left out changes what orientations hold beside colors: so often at most."""
RIDGE = 1e-4
"""Share of the colors' power that is added to each of them where orientations are explained by them."""


def undisturbed(statistics: CovarianceState, tau: float, piece: float, limits: SumCriteria) -> Tensor:
    """Covariances of the stretches of time without disturbance, the latest with the most weight.

    Args:
        statistics: with pieces `[..., P, L, 10, 10]`, the second delay the shortest.
        tau: the memory, seconds.
        piece: length of a piece, seconds.
        limits: of what is left out.

    Returns:
        `[..., L, 10, 10]`, as strong as a memory of all of them.
    """
    held, age = statistics.held, statistics.age.unsqueeze(-1)
    pieces = statistics.pieces / held.clamp_min(1)[:, None, None, None]
    count, there = len(held), held > 0
    since = piece * torch.arange(count - 1, -1, -1, dtype=pieces.dtype, device=pieces.device)
    weight = held * torch.exp(-since / tau)
    total = (weight[:, None, None, None] * pieces).sum(-4) / weight.sum().clamp_min(1)
    scale = spread_groups(group_max(total[..., 0, :, :].diagonal(dim1=-2, dim2=-1).clamp_min(0).sqrt()))
    delayed = divide(pieces[..., 1, :, :], (scale.unsqueeze(-1) * scale.unsqueeze(-2)).unsqueeze(-3)).double()
    keep = there.expand(delayed.shape[:-2])
    for _ in range(ROUNDS):
        left = beside_colors(delayed, keep * weight, there, limits)
        if bool((left == keep).all()):
            break
        keep = left
    chosen = keep * weight
    share = chosen * (1 - torch.exp(-age / tau)) / chosen.sum(-1, keepdim=True).clamp_min(1e-12)
    found: Tensor = (share[..., None, None, None] * pieces).sum(-4)
    return found


def beside_colors(delayed: Tensor, weight: Tensor, there: Tensor, limits: SumCriteria) -> Tensor:
    """Which pieces hold no more beside the colors than most do, `[..., P]` bool.

    Args:
        delayed: covariances at the shortest delay, of motion, orientations and colors, `[..., P, 10, 10]`.
        weight: of those that are kept, `[..., P]`.
        there: which hold anything, `[..., P]` bool.
        limits: see there.
    """
    orientation, color = GROUPS["orientation"], GROUPS["color"]
    whole = (weight[..., None, None] * delayed).sum(-3) / weight.sum(-1).clamp_min(1e-12)[..., None, None]
    colors = whole[..., color, color]
    power = colors.diagonal(dim1=-2, dim2=-1).sum(-1).clamp_min(1e-12)
    ridge = RIDGE * power[..., None, None] * torch.eye(3, dtype=colors.dtype, device=colors.device)
    explained = torch.linalg.solve(colors + ridge, whole[..., color, orientation]).mT.unsqueeze(-3)
    rest = (
        delayed[..., orientation, orientation]
        - 2 * explained @ delayed[..., color, orientation]
        + explained @ delayed[..., color, color] @ explained.mT
    )
    left = rest.diagonal(dim1=-2, dim2=-1).sum(-1)
    middle = torch.where(there, left, torch.nan).nanmedian(-1, keepdim=True).values
    largest = whole[..., orientation, orientation].diagonal(dim1=-2, dim2=-1).sum(-1, keepdim=True)
    kept: Tensor = there & (left <= torch.maximum(limits.covered * middle, limits.beside * largest))
    return kept
