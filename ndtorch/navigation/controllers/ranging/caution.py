"""Never on what is not seen: whether the ranging controller may begin, and how fast it may go on the floor it knows."""

from __future__ import annotations

import torch
from torch import Tensor

from ndtorch.navigation.controllers.contract import STOPPED, SUPPRESSED
from ndtorch.navigation.controllers.ranging.floor import FloorConstants, FloorState
from ndtorch.navigation.controllers.ranging.patch import Patch, PatchParams, cell_numbers
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity.stereo_match import Obstacles

LEAST, FULL = 0.25, 0.75
"""Shares of the bands of floor that are told from noise: up to the first it stands, from the second on it is fast."""

SETTLED = 0.95
"""Noise that falls below so much of what it was a step before has not settled yet."""


def remember_near(
    patch: Patch,
    pose: Pose,
    things: Obstacles,
    across: Obstacles,
    floor_seen: bool,
    blocked: float,
    params: PatchParams,
) -> Patch:
    """The patch of one car after a near check: things are blocked at once, and the way ahead where no floor is seen."""
    evidence = patch.evidence.clone()

    def numbers(near: Obstacles) -> Tensor:
        places = torch.stack((torch.from_numpy(near.x), torch.from_numpy(near.y))).to(evidence.dtype)
        return cell_numbers(places, pose, params)

    ahead = numbers(across)
    here = evidence[ahead]
    evidence[ahead] = here.clamp(max=0.0) if floor_seen else here.clamp(min=blocked + 0.1)
    if len(things.x):
        found = numbers(things)
        evidence[found] = evidence[found].clamp(min=blocked + 0.1)
    return patch._replace(evidence=evidence)


def woken(mode: Tensor, floor: FloorState, constants: FloorConstants) -> Tensor:
    """The mode before a step: a car that stood because it could not begin tries to begin again."""
    cold = (mode == STOPPED) & (floor.level.amax(-1) == 0) & (floor.age <= constants.standing)
    return torch.where(cold, torch.full_like(mode, SUPPRESSED), mode)


def known_share(floor: FloorState, flow: Tensor, least: float, constants: FloorConstants) -> Tensor:
    """Share of the bands in which floor would be told from noise at full speed, `[...]`; 1 while it is learned.

    Args:
        flow: pixels a step at that speed, `[bands]`.
        least: noise of pictures that have none, since they come in 256 levels.
    """
    expected = floor.level * -torch.expm1(flow * constants.saturation)
    noise = floor.noise.clamp(min=least).unsqueeze(-1)
    share = (expected > noise * constants.clear).to(expected.dtype).mean(-1)
    return torch.where(floor.age <= constants.learning, torch.ones_like(share), share)


def settling(noise: Tensor, before: Tensor) -> Tensor:
    """Whether what is taken for noise still falls, `[...]` bool.

    It changes only while the wheels stand. Somebody who walks past a standing car is noise for as long, and who
    drives off as soon as the first floor is told from it goes slowly until it stands again.
    """
    return noise < SETTLED * before


def speed_share(share: Tensor) -> Tensor:
    """How much of its speed a car may have that knows such a share of its floor."""
    return ((share - LEAST) / (FULL - LEAST)).clamp(0.0, 1.0)
