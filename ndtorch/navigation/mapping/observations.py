"""The map as a list: what was seen lately and from where."""

from __future__ import annotations

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
        lifetime: seconds in which its weight falls to 1/e.
        seen_from: `[..., K, 3]`, the pose (x, y, heading) it was seen from.
    """

    x: Tensor
    y: Tensor
    weight: Tensor
    lifetime: Tensor
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
        lifetime: seconds in which a new observation's weight falls to 1/e; inf forgets nothing.
        weight: of a new observation.

    Raises:
        InputError: numbers out of range, or ranges and poses that do not belong together.
    """

    def __init__(self, dt: float, capacity: int = 512, lifetime: float = 6.0, weight: float = 1.0) -> None:
        super().__init__()
        check_number("dt", dt, above=0, unit="seconds")
        check_number("capacity", capacity, above=0, whole=True)
        check_number("lifetime", lifetime, above=0, unit="seconds", endless=True)
        check_number("weight", weight, above=0)
        self.dt, self.capacity, self.lifetime, self.weight = dt, capacity, lifetime, weight

    def forward(
        self, ranges: Ranges, pose: Pose, state: Observations | None = None
    ) -> tuple[Observations, Observations]:
        check_state(state, Observations)
        batch = check_observations(ranges, pose)
        check_batch(state, batch, "x", "seen_from")
        if state is None:
            blank = ranges.x.new_zeros(*batch, self.capacity)
            state = Observations(blank, blank, blank, blank + 1.0, blank.new_zeros(*blank.shape, 3))
        weight = ranges.valid.to(ranges.x.dtype) * self.weight
        x, y = to_world(Pose(*(part.unsqueeze(-1) for part in pose)), ranges.x, ranges.y)
        for t in range(pose.x.shape[-1]):
            state = state._replace(weight=state.weight * torch.exp(-self.dt / state.lifetime))
            here = torch.stack([part[..., t] for part in pose], -1).unsqueeze(-2)
            state = self.add(state, x[..., t, :], y[..., t, :], weight[..., t, :], here)
        return state, state

    def add(
        self,
        state: Observations,
        x: Tensor,
        y: Tensor,
        weight: Tensor,
        seen_from: Tensor,
        lifetime: float | None = None,
    ) -> Observations:
        """Put points at the front of the list, for instance virtual ones where a rule suspects a wall.

        Args:
            x, y: world, m; `[..., n]`.
            weight: `[..., n]`; points of weight 0 take a slot and count nothing.
            seen_from: pose, broadcast to `[..., n, 3]`.
            lifetime: of these points; the module's own by default.
        """
        seconds = torch.full_like(x, self.lifetime if lifetime is None else lifetime)
        first, dims = (x, y, weight, seconds, seen_from.expand(*x.shape, 3)), (-1, -1, -1, -1, -2)
        parts = zip(first, state, dims, strict=True)
        return Observations(*(torch.cat((new, old), dim).narrow(dim, 0, self.capacity) for new, old, dim in parts))
