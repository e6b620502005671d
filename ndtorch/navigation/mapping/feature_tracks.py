"""Tracks of ranged features, and which of them move while the world stands still."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_batch, check_number, check_numbers, check_state
from ndtorch.errors import InputError
from ndtorch.navigation.mapping.grid_map import check_observations
from ndtorch.navigation.odometry import Pose, to_world
from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch.vision.temporal import corrected, predicted


@dataclass(frozen=True)
class FeatureTrackParams:
    """Parameters of `AlphaBetaTracker`.

    Args:
        alpha: Ratio of the residual by which the position of a track is corrected (0..1).
        beta: Ratio of the residual, over the time step, by which its velocity is corrected (0..1).
        gate_m: Largest distance of an observation from the predicted position of its track.
        slots: Number of tracks that are kept.
        max_lost_s: Time without observations after which a track ends.
        min_age_s: Age from which on a track can be dynamic.
        min_speed_m_per_s: Speed through the world above which a track is dynamic.

    Raises:
        InputError: A number is out of range.
    """

    alpha: float = 0.3
    beta: float = 0.03
    gate_m: float = 0.25
    slots: int = 16
    max_lost_s: float = 0.5
    min_age_s: float = 0.8
    min_speed_m_per_s: float = 0.2

    def __post_init__(self) -> None:
        check_numbers(self, endless=["max_lost_s"], positive=("alpha", "beta", "gate_m", "slots"))
        if not (self.alpha <= 1 and self.beta <= 1):
            raise InputError(f"expected alpha and beta in 0..1, got {self}")


class Tracks(NamedTuple):
    """State of `AlphaBetaTracker`, K slots.

    Attributes:
        place, velocity: in the world, m and m/s, `[..., K, 2]`.
        age: seconds since the track began, `[..., K]`.
        unseen: seconds since it was last seen; infinite in empty slots.
        dynamic: bool; moves in a way that the car's own motion does not explain.
    """

    place: Tensor
    velocity: Tensor
    age: Tensor
    unseen: Tensor
    dynamic: Tensor


def track_step(seen: Tensor, valid: Tensor, state: Tracks, params: FeatureTrackParams, dt: float) -> Tracks:
    """One step of all tracks. [A §3]

    Since places are in the world, the car's own motion is already taken out: the predicted velocity of
    everything that stands still is zero. Track and observation belong together when each is the other's
    nearest and they lie within the gate; observations left over begin new tracks in empty or the longest
    unseen slots.

    Args:
        seen: observed places `[..., n, 2]` in the world; `valid` `[..., n]`.
    """
    alive = state.unseen <= params.max_lost_s
    unseen = torch.where(alive, state.unseen + dt, math.inf)
    place = predicted(state.place, state.velocity, dt)
    distance = torch.linalg.vector_norm(place.unsqueeze(-2) - seen.unsqueeze(-3), dim=-1)
    distance = torch.where(alive.unsqueeze(-1) & valid.unsqueeze(-2), distance, math.inf)
    nearest, index = distance.min(-1)
    mutual = distance.argmin(-2).gather(-1, index) == torch.arange(params.slots, device=seen.device)
    hit = mutual & (nearest <= params.gate_m)

    residual = torch.where(hit.unsqueeze(-1), seen.gather(-2, index.unsqueeze(-1).expand(*index.shape, 2)) - place, 0.0)
    place, velocity = corrected(place, state.velocity, residual, params.alpha, params.beta, dt)
    unseen, age = torch.where(hit, 0.0, unseen), state.age + dt

    # An observation begins a track in the emptiest slot unless it lies within the gate of one.
    fresh = valid & (distance.amin(-2) > params.gate_m)
    count = min(fresh.shape[-1], params.slots)
    slot = unseen.argsort(dim=-1, descending=True, stable=True)[..., :count]
    order = fresh.to(torch.int8).argsort(dim=-1, descending=True, stable=True)[..., :count]
    begins = fresh.gather(-1, order) & (unseen.gather(-1, slot) > 0)
    begun = torch.zeros_like(alive).scatter(-1, slot, begins)
    first = seen.gather(-2, order.unsqueeze(-1).expand(*order.shape, 2))
    place = torch.where(begun.unsqueeze(-1), place.scatter(-2, slot.unsqueeze(-1).expand(*slot.shape, 2), first), place)
    velocity = torch.where(begun.unsqueeze(-1), 0.0, velocity)
    age, unseen = torch.where(begun, 0.0, age), torch.where(begun, 0.0, unseen)

    fast = torch.linalg.vector_norm(velocity, dim=-1) > params.min_speed_m_per_s
    dynamic = fast & (age >= params.min_age_s) & (unseen <= params.max_lost_s)
    return Tracks(place, velocity, age, unseen, dynamic)


class AlphaBetaTracker(nn.Module):
    """Follows ranged features through the world with alpha-beta filters and flags the ones that move. [A §3]

    Called as `tracks, state = tracker(ranges, pose, state)`; `tracks` is the state after the last frame.

    Shapes:
        ranges `[..., T, n]`, pose `[..., T]` -> `Tracks` of `[..., K]`. `state=None` starts without tracks.

    Raises:
        InputError: dt not positive, or ranges and poses that do not belong together.
    """

    def __init__(self, dt: float, params: FeatureTrackParams | None = None) -> None:
        super().__init__()
        check_number("dt", dt, above=0, unit="seconds")
        self.dt, self.params = dt, params or FeatureTrackParams()

    def forward(self, ranges: Ranges, pose: Pose, state: Tracks | None = None) -> tuple[Tracks, Tracks]:
        check_state(state, Tracks)
        batch = check_observations(ranges, pose)
        check_batch(state, batch, "place", "unseen")
        if state is None:
            blank = ranges.x.new_zeros(*batch, self.params.slots)
            pairs = ranges.x.new_zeros(*batch, self.params.slots, 2)
            state = Tracks(pairs, pairs, blank, blank + math.inf, blank > 0)
        x, y = to_world(Pose(*(part.unsqueeze(-1) for part in pose)), ranges.x, ranges.y)
        places = torch.stack((x, y), -1)
        for t in range(pose.x.shape[-1]):
            state = track_step(places[..., t, :, :], ranges.valid[..., t, :], state, self.params, self.dt)
        return state, state
