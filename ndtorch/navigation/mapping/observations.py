"""The map as a list: what was seen lately and from where."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_batch, check_number, check_state
from ndtorch.navigation.mapping.grid_map import check_observations
from ndtorch.navigation.odometry import Pose, to_world
from ndtorch.navigation.stereo.ranging import Ranges


class Observations(NamedTuple):
    """State of `ObservationList`: the K newest observations, newest first, each part `[..., K]`.

    Attributes:
        x, y: where it is in the world, m.
        weight: what it still counts; 0 in slots that are empty.
        seen_from: `[..., K, 3]`, the pose (x, y, heading) it was seen from.
    """

    x: Tensor
    y: Tensor
    weight: Tensor
    seen_from: Tensor


class ObservationList(nn.Module):
    """A list of places in place of a grid, [A §3]: little memory, and answers computed when asked.

    Called as `observations, state = module(ranges, pose, state)`; `observations` is the state. Weights fall
    exponentially with time. The oldest observations leave when the list is full.

    Shapes:
        ranges `[..., T, n]`, pose `[..., T]` -> `Observations` of `[..., K]`. `state=None` starts empty.

    Args:
        dt: time step, s.
        capacity: length of the list, K, at least n.
        lifetime: seconds in which an observation's weight falls from 1 to 1/e; inf forgets nothing.

    Raises:
        InputError: numbers out of range, or ranges and poses that do not belong together.
    """

    def __init__(self, dt: float, capacity: int = 512, lifetime: float = 6.0) -> None:
        super().__init__()
        check_number("dt", dt, above=0, unit="seconds")
        check_number("capacity", capacity, above=0, whole=True)
        check_number("lifetime", lifetime, above=0, unit="seconds", endless=True)
        self.capacity, self.keep = capacity, math.exp(-dt / lifetime)

    def forward(
        self, ranges: Ranges, pose: Pose, state: Observations | None = None
    ) -> tuple[Observations, Observations]:
        check_state(state, Observations)
        batch = check_observations(ranges, pose)
        check_batch(state, batch, "x", "seen_from")
        if state is None:
            blank = ranges.x.new_zeros(*batch, self.capacity)
            state = Observations(blank, blank, blank, blank.new_zeros(*blank.shape, 3))
        x, y = to_world(Pose(*(part.unsqueeze(-1) for part in pose)), ranges.x, ranges.y)
        seen_from = torch.stack(pose, -1).unsqueeze(-2).expand(*x.shape, 3)
        new = Observations(x, y, ranges.valid.to(x.dtype), seen_from)
        for t in range(x.shape[-2]):
            state = state._replace(weight=state.weight * self.keep)
            parts = zip(new, state, (-1, -1, -1, -2), strict=True)
            state = Observations(
                *(torch.cat((one.select(k - 1, t), old), k).narrow(k, 0, self.capacity) for one, old, k in parts)
            )
        return state, state
