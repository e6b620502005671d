"""The whole of navigation by paper A: two cameras in, speed and curvature out, and a map on the way."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.navigation.avoidance import AvoidanceParams, AvoidanceState, Command, SaccadeAvoidance
from ndtorch.navigation.correspondence import MatchParams
from ndtorch.navigation.features import FeatureParams
from ndtorch.navigation.mapping import GridMap, GridMapState
from ndtorch.navigation.observations import ObservationList, Observations
from ndtorch.navigation.odometry import DeadReckoning, Pose
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import AngleModel, Rect, StereoRig
from ndtorch.navigation.sensors import RowRanging, SubfieldMotion
from ndtorch.navigation.strips import Strips
from ndtorch.navigation.tracking import AlphaBetaTracker, Tracks
from ndtorch.vision.temporal import FilterState


class NavigatorState(NamedTuple):
    """State of `Navigator`, and what it last saw.

    Attributes:
        fields, rows: filters of the subfields and of the horizon rows.
        avoidance: the state machine.
        command: the last command, `[...]`, driven until the next frame.
        pose: where the car was at the last frame, `[...]`.
        sides: speed estimates of the last frame, `[..., 2]`.
        ranges: of the last frame, `[..., n]`.
        map, observations, tracks: states of those parts, None where the navigator has none.
    """

    fields: FilterState
    rows: FilterState
    avoidance: AvoidanceState
    command: Command
    pose: Pose
    sides: Tensor
    ranges: Ranges
    map: GridMapState | None
    observations: Observations | None
    tracks: Tracks | None


class Navigator(nn.Module):
    """Avoids obstacles and ranges what it passes: the published architecture of [A] as one module.

    Only the two subfields and the two horizon rows are read. At the first frame the car is at the origin and
    stands still. Nearly all the time of a step goes into calling torch, not into sums: it takes a fifth less
    under `torch.inference_mode()`, and a batch of 64 cars takes four times as long as one.

    Shapes:
        left, right: frames `[..., T, C, H, W]` of the two cameras, uint8 or float in 0..1, C = 3 (RGB) or 1,
            or `Strips` cut out of them.
        driven: what the car really did on the way to each frame, `Command` of `[..., T]`; by default the
            command given at the frame before.
        command: `Command` of `[..., T]`, what to do from each frame on.

    Args:
        rig: the camera pair.
        dt: time step, s.
        avoidance, features, matching: parameters of the steps.
        angles: `"atan"` (exact) or `"linear"` (as published).
        fields: the subfields; `rig.subfields()` by default.
        grid_map, observations, tracker: parts to fill with the ranges; none by default.

    Raises:
        InputError: frames that cannot be used: two sizes, grey beside colour, NaN or infinity.
    """

    def __init__(
        self,
        rig: StereoRig,
        dt: float,
        *,
        avoidance: AvoidanceParams | None = None,
        features: FeatureParams | None = None,
        matching: MatchParams | None = None,
        angles: AngleModel = "atan",
        fields: tuple[Rect, Rect] | None = None,
        grid_map: GridMap | None = None,
        observations: ObservationList | None = None,
        tracker: AlphaBetaTracker | None = None,
    ) -> None:
        super().__init__()
        self.motion = SubfieldMotion(rig, dt, fields)
        self.avoidance = SaccadeAvoidance(dt, avoidance)
        self.ranging = RowRanging(rig, dt, features, matching, angles)
        self.reckoning = DeadReckoning(dt)
        self.grid_map, self.observations, self.tracker = grid_map, observations, tracker

    def forward(
        self,
        left: Tensor | Strips,
        right: Tensor | Strips,
        state: NavigatorState | None = None,
        driven: Command | None = None,
    ) -> tuple[Command, NavigatorState]:
        left_field, left_row = strips(left)
        right_field, right_row = strips(right)
        sides, fields = self.motion(left_field, right_field, state.fields if state else None)
        command, avoidance = self.avoidance(sides, state.avoidance if state else None)
        ranges, rows = self.ranging(left_row, right_row, state.rows if state else None)
        if ranges.x.shape[:-1] != command.speed.shape:
            raise InputError(
                f"subfields and rows must be of the same frames, "
                f"got {tuple(left_field.shape)} and {tuple(left_row.shape)}"
            )
        if driven is None:
            driven = Command(*(delayed(c, b) for c, b in zip(command, before(state, command), strict=True)))
        poses, pose = self.reckoning(driven.speed, driven.curvature, state.pose if state else None)
        grid, seen, tracks = (state.map, state.observations, state.tracks) if state else (None, None, None)
        if self.grid_map is not None:
            _, grid = self.grid_map(ranges, poses, grid)
        if self.observations is not None:
            _, seen = self.observations(ranges, poses, seen)
        if self.tracker is not None:
            _, tracks = self.tracker(ranges, poses, tracks)
        last = Command(command.speed[..., -1], command.curvature[..., -1])
        ranges = Ranges(*(part[..., -1, :] for part in ranges))
        return command, NavigatorState(
            fields, rows, avoidance, last, pose, sides[..., -1, :], ranges, grid, seen, tracks
        )


def strips(eye: Tensor | Strips) -> Strips:
    """Whole frames stand for both of their strips: each step cuts its own."""
    return eye if isinstance(eye, Strips) else Strips(eye, eye)


def before(state: NavigatorState | None, command: Command) -> Command:
    """The command in force when the first frame was taken: standing still where nothing went before."""
    if state is not None:
        return state.command
    still = torch.zeros_like(command.speed[..., 0])
    return Command(still, still)


def delayed(values: Tensor, first: Tensor) -> Tensor:
    """Values `[..., T]` one step later, beginning with `first` `[...]`."""
    return torch.cat([first.unsqueeze(-1), values[..., :-1]], -1)
