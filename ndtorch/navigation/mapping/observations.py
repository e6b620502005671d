"""What was ranged as lists: observations and from where, and tracks of features, of which some move."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_batch, check_number, check_state
from ndtorch.errors import InputError
from ndtorch.navigation.mapping.grid_map import check_observations
from ndtorch.navigation.odometry import Pose, to_world
from ndtorch.navigation.stereo.ranging import Ranges


class Observations(NamedTuple):
    """State of `ObservationList`: the K newest observations, newest first, each part `[..., K]`."""

    x: Tensor  # x, y: where it is in the world, m
    y: Tensor
    weight: Tensor  # what it still counts; 0 in slots that are empty
    seen_from: Tensor  # `[..., K, 3]`, the pose (x, y, heading) it was seen from


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


GATE_M, MAX_LOST_S = 0.25, 0.5
"""Largest distance of an observation from the predicted position of its track, and the time without observations after
which a track ends."""

MIN_AGE_S, MIN_SPEED_M_PER_S = 0.8, 0.2  # age and speed through the world from which on a track is dynamic


class FeatureTracks(NamedTuple):
    """State of `AlphaBetaTracker`, K slots."""

    place: Tensor  # place, velocity: in the world, m and m/s, `[..., K, 2]`
    velocity: Tensor
    age: Tensor  # seconds since the track began, `[..., K]`
    unseen: Tensor  # seconds since it was last seen; infinite in empty slots
    dynamic: Tensor  # bool; moves in a way that the car's own motion does not explain


class AlphaBetaTracker(nn.Module):
    """Follows ranged features through the world with alpha-beta filters and flags the ones that move. [A §3]

    Called as `tracks, state = tracker(ranges, pose, state)`; `tracks` is the state after the last frame.

    Shapes:
        ranges `[..., T, n]`, pose `[..., T]` -> `Tracks` of `[..., K]`. `state=None` starts without tracks.

    Args:
        dt: time step, s.
        alpha: ratio of the residual by which the position of a track is corrected.
        beta: ratio of the residual, over the time step, by which its velocity is corrected.
        slots: number of tracks that are kept.

    Raises:
        InputError: numbers out of range, or ranges and poses that do not belong together.
    """

    def __init__(self, dt: float, alpha: float = 0.3, beta: float = 0.03, slots: int = 16) -> None:
        super().__init__()
        check_number("dt", dt, above=0, unit="seconds")
        check_number("slots", slots, above=0, whole=True)
        if not (0 < alpha <= 1 and 0 < beta <= 1):
            raise InputError(f"expected alpha and beta above 0 and at most 1, got {alpha} and {beta}")
        self.dt, self.alpha, self.beta, self.slots = dt, alpha, beta, slots

    def forward(
        self, ranges: Ranges, pose: Pose, state: FeatureTracks | None = None
    ) -> tuple[FeatureTracks, FeatureTracks]:
        check_state(state, FeatureTracks)
        batch = check_observations(ranges, pose)
        check_batch(state, batch, "place", "unseen")
        if state is None:
            blank = ranges.x.new_zeros(*batch, self.slots)
            pairs = ranges.x.new_zeros(*batch, self.slots, 2)
            state = FeatureTracks(pairs, pairs, blank, blank + math.inf, blank > 0)
        x, y = to_world(Pose(*(part.unsqueeze(-1) for part in pose)), ranges.x, ranges.y)
        places = torch.stack((x, y), -1)
        for t in range(pose.x.shape[-1]):
            state = self.step(places[..., t, :, :], ranges.valid[..., t, :], state)
        return state, state

    def step(self, seen: Tensor, valid: Tensor, state: FeatureTracks) -> FeatureTracks:
        """One step of all tracks, with places seen `[..., n, 2]` in the world. [A §3]

        Since places are in the world, the car's own motion is already taken out: the predicted velocity of
        everything that stands still is zero. Track and observation belong together when each is the other's
        nearest and they lie within the gate; observations left over begin new tracks in empty or the longest
        unseen slots.
        """
        dt = self.dt
        alive = state.unseen <= MAX_LOST_S
        unseen = torch.where(alive, state.unseen + dt, math.inf)
        place = state.place + state.velocity * dt
        distance = torch.linalg.vector_norm(place.unsqueeze(-2) - seen.unsqueeze(-3), dim=-1)
        distance = torch.where(alive.unsqueeze(-1) & valid.unsqueeze(-2), distance, math.inf)
        nearest, index = distance.min(-1)
        mutual = distance.argmin(-2).gather(-1, index) == torch.arange(self.slots, device=seen.device)
        hit = mutual & (nearest <= GATE_M)

        residual = torch.where(
            hit.unsqueeze(-1), seen.gather(-2, index.unsqueeze(-1).expand(*index.shape, 2)) - place, 0.0
        )
        place, velocity = place + self.alpha * residual, state.velocity + self.beta * residual / dt
        unseen, age = torch.where(hit, 0.0, unseen), state.age + dt

        # An observation begins a track in the emptiest slot unless it lies within the gate of one.
        fresh = valid & (distance.amin(-2) > GATE_M)
        count = min(fresh.shape[-1], self.slots)
        slot = unseen.argsort(dim=-1, descending=True, stable=True)[..., :count]
        order = fresh.to(torch.int8).argsort(dim=-1, descending=True, stable=True)[..., :count]
        begins = fresh.gather(-1, order) & (unseen.gather(-1, slot) > 0)
        begun = torch.zeros_like(alive).scatter(-1, slot, begins)
        first = seen.gather(-2, order.unsqueeze(-1).expand(*order.shape, 2))
        place = torch.where(
            begun.unsqueeze(-1), place.scatter(-2, slot.unsqueeze(-1).expand(*slot.shape, 2), first), place
        )
        velocity = torch.where(begun.unsqueeze(-1), 0.0, velocity)
        age, unseen = torch.where(begun, 0.0, age), torch.where(begun, 0.0, unseen)

        fast = torch.linalg.vector_norm(velocity, dim=-1) > MIN_SPEED_M_PER_S
        dynamic = fast & (age >= MIN_AGE_S) & (unseen <= MAX_LOST_S)
        return FeatureTracks(place, velocity, age, unseen, dynamic)
