"""What stands above floor that is seen: below a sofa or a table floor goes on, and a range is all that tells of it.

So ranges go into evidence of their own, which no floor takes away. What does is a range behind it, on whose line of
sight it would lie, the car itself, and time.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.controllers.ranging.patch import Patch, cell_numbers
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import StereoRig

LINE = (0.15, 0.88, 24)
"""From and up to which share of a range its line of sight counts as seen through, and how many places of it."""


def remember_ranges(
    patch: Patch, ranges: Ranges, pose: Pose, body: Tensor, rig: StereoRig, params: RangingParams
) -> Patch:
    """The patch with ranges added to what stands.

    Args:
        patch: moved to where the car is, see `move_patch`.
        ranges: of this frame, `[..., n]`.
        body: places below the car, body frame, `[2, k]`.
    """
    p, batch = params.patch, pose.x.shape
    first, last, count = LINE
    line = torch.linspace(first, last, count).to(ranges.x)
    from_eye = ranges.x - rig.forward, ranges.y - rig.baseline / 2
    through = torch.stack(
        (rig.forward + from_eye[0].unsqueeze(-1) * line, rig.baseline / 2 + from_eye[1].unsqueeze(-1) * line), -3
    ).flatten(-2)
    # Several places of a line may lie in one cell: together they take `miss`.
    apart = torch.hypot(*from_eye) * ((last - first) / (count - 1) / p.cell)
    miss = (-params.miss * apart.clamp(max=1.0) * ranges.valid).unsqueeze(-1).expand(*ranges.x.shape, count)
    here = torch.stack((ranges.x, ranges.y), -2)
    found = (ranges.valid & (here.abs().amax(-2) < p.reach)) * params.range_weight
    places = torch.cat((here, through, body.expand(*batch, *body.shape)), -1)
    under = here.new_full((*batch, body.shape[-1]), -p.least)
    weight = torch.cat((found, miss.flatten(-2), under), -1)
    upright = patch.upright.scatter_add(-1, cell_numbers(places, pose, p), weight).clamp(-p.least, p.most)
    return patch._replace(upright=upright)


def in_the_way(patch: Patch, blocked: float) -> Tensor:
    """Evidence `[..., size * size]` in which what stands is blocked."""
    if not patch.upright.shape[-1]:
        return patch.evidence
    return torch.where(patch.upright >= blocked, patch.evidence.clamp(min=blocked), patch.evidence)
