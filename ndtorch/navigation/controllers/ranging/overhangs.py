"""What stands above floor that is seen: below a sofa or a table floor goes on, and a range is all that tells of it.

So ranges go into evidence of their own, which no floor takes away. What does is a range behind it, on whose line of
sight it would lie, the car itself, and time. A turn may lead to what was never ranged because it is nearer than the
least range: in turns both rows are compared for that, a few times a second.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.controllers.ranging.patch import Patch, cell_numbers
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity.stereo_match import Obstacles
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
    line, (ahead, aside, taken, apart) = line_of_sight(ranges.x), beam_numbers(rig, params)
    x, y = ranges.x - ahead, ranges.y - aside
    through = torch.stack((ahead + x.unsqueeze(-1) * line, aside + y.unsqueeze(-1) * line), -3).flatten(-2)
    miss = -taken * (torch.hypot(x, y) * apart).clamp(max=1.0) * ranges.valid
    miss = miss.unsqueeze(-1).expand(*ranges.x.shape, len(line))
    here = torch.stack((ranges.x, ranges.y), -2)
    found = (ranges.valid & (here.abs().amax(-2) < p.reach)) * params.range_weight
    places = torch.cat((here, through, body.expand(*batch, *body.shape)), -1)
    under = here.new_full((*batch, body.shape[-1]), -p.least)
    weight = torch.cat((found, miss.flatten(-2), under), -1)
    upright = patch.upright.scatter_add(-1, cell_numbers(places, pose, p), weight).clamp(-p.least, p.most)
    return patch._replace(upright=upright)


def remember_things(patch: Patch, pose: Pose, things: Obstacles, params: RangingParams) -> Patch:
    """The patch of one car with the cells in which things are, each of which counts as one range."""
    if not len(things.x) or not patch.upright.shape[-1]:
        return patch
    places = torch.stack((torch.from_numpy(things.x), torch.from_numpy(things.y))).to(patch.upright)
    number = cell_numbers(places, pose, params.patch)
    upright = patch.upright.clone()
    # What was seen free before there was any look at so near a thing says nothing.
    upright[number] = (upright[number].clamp(min=0.0) + params.range_weight).clamp(max=params.patch.most)
    return patch._replace(upright=upright)


def line_of_sight(like: Tensor) -> Tensor:
    """Shares of a range at which its line of sight counts as seen through."""
    first, last, count = LINE
    return torch.linspace(first, last, count).to(like)


def beam_numbers(rig: StereoRig, params: RangingParams) -> tuple[float, float, float, float]:
    """Where the left eye is, ahead and aside, m; evidence that a line of sight takes from a cell; and how many cells
    two places of a line are apart for each metre of range, since those in one cell take that much together."""
    first, last, count = LINE
    return rig.forward, rig.baseline / 2, params.miss, (last - first) / (count - 1) / params.patch.cell


def in_the_way(patch: Patch, blocked: float) -> Tensor:
    """Evidence `[..., size * size]` in which what stands is blocked."""
    if not patch.upright.shape[-1]:
        return patch.evidence
    return torch.where(patch.upright >= blocked, patch.evidence.clamp(min=blocked), patch.evidence)
