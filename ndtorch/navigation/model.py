"""The whole of navigation: two cameras in, speed and curvature out, and a map on the way."""

from __future__ import annotations

from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.navigation.avoidance import AvoidanceParams, AvoidanceState, Command, SaccadeAvoidance
from ndtorch.navigation.correspondence import MatchParams
from ndtorch.navigation.features import FeatureParams
from ndtorch.navigation.floor import FloorMotion
from ndtorch.navigation.mapping import GridMap, GridMapState
from ndtorch.navigation.observations import ObservationList, Observations
from ndtorch.navigation.odometry import DeadReckoning, Pose
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.ranging_control import RangingControl, RangingParams, RangingState
from ndtorch.navigation.rig import AngleModel, Rect, StereoRig
from ndtorch.navigation.sensors import RowRanging, RowRangingState, SubfieldMotion
from ndtorch.navigation.strips import Strips
from ndtorch.navigation.tracking import AlphaBetaTracker, Tracks
from ndtorch.vision.temporal import FilterState

Controller = Literal["published", "ranging"]


class NavigatorState(NamedTuple):
    """State of `Navigator`, and what it last saw.

    Attributes:
        fields, rows: states of what reads the subfields and the horizon rows.
        avoidance: the controller's own state.
        command: the last command, `[...]`, driven until the next frame.
        pose: where the car was at the last frame, `[...]`.
        sides: speed estimates of the last frame, `[..., 2]`.
        ranges: of the last frame, `[..., n]`.
        map, observations, tracks: states of those parts, None where the navigator has none.
    """

    fields: FilterState
    rows: RowRangingState
    avoidance: AvoidanceState | RangingState
    command: Command
    pose: Pose
    sides: Tensor
    ranges: Ranges
    map: GridMapState | None
    observations: Observations | None
    tracks: Tracks | None


class Navigator(nn.Module):
    """Avoids obstacles and ranges what it passes: the architecture of [A] as one module.

    Two controllers can sit at its wheel: `"published"`, the saccades of [A], and `"ranging"`, which drives
    where it has seen floor (`RangingControl`). Only the two subfields and the two horizon rows are read. At
    the first frame the car is at the origin and stands still. Nearly all the time of a step goes into calling
    torch, not into sums: it takes a fifth less under `torch.inference_mode()`, and a batch of 64 cars takes
    four times as long as one.

    Shapes:
        left, right: frames `[..., T, C, H, W]` of the two cameras, uint8 or float in 0..1, C = 3 (RGB) or 1,
            or `Strips` cut out of them.
        driven: what the car really did on the way to each frame, `Command` of `[..., T]`; by default the
            command given at the frame before.
        command: `Command` of `[..., T]`, what to do from each frame on.

    Args:
        rig: the camera pair.
        dt: time step, s.
        avoidance, features, matching: parameters of the steps; `avoidance` of the published controller.
            `FeatureParams(7, edge_reach=4, shared=True)` ranges better than the published default.
        angles: `"atan"` (exact) or `"linear"` (as published).
        fields: the subfields of the published controller; `rig.subfields()` by default.
        grid_map, observations, tracker: parts to fill with the ranges; none by default.
        controller: `"published"` or `"ranging"`.
        ranging: parameters of the ranging controller.

    Raises:
        InputError: an unknown controller, or parameters of the other one; frames that cannot be used: two sizes,
            grey beside colour, NaN or infinity.
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
        controller: Controller = "published",
        ranging: RangingParams | None = None,
    ) -> None:
        super().__init__()
        if controller not in ("published", "ranging"):
            raise InputError(f"controller must be 'published' or 'ranging', got {controller!r}")
        foreign = ranging if controller == "published" else avoidance or fields
        if foreign is not None:
            raise InputError(f"the {controller} controller cannot use {type(foreign).__name__}")
        self.motion: SubfieldMotion | FloorMotion
        self.avoidance: SaccadeAvoidance | RangingControl
        if controller == "published":
            self.motion, self.avoidance = SubfieldMotion(rig, dt, fields), SaccadeAvoidance(dt, avoidance)
        else:
            self.avoidance = RangingControl(rig, dt, ranging)
            self.motion = FloorMotion(rig, dt, self.avoidance.params.floor)
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
        command, state, ranges, poses = self.see_and_steer(left, right, state, driven)
        return command, self.remember(state, ranges, poses)

    def see_and_steer(
        self,
        left: Tensor | Strips,
        right: Tensor | Strips,
        state: NavigatorState | None = None,
        driven: Command | None = None,
    ) -> tuple[Command, NavigatorState, Ranges, Pose]:
        """All but the memory: command, state, and the ranges and poses of every frame, which `remember` takes."""
        left_field, left_row = strips(left)
        right_field, right_row = strips(right)
        motion, fields = self.motion(left_field, right_field, state.fields if state else None)
        ranges, rows = self.ranging(left_row, right_row, state.rows if state else None)
        time = motion.shape[: ranges.x.ndim - 1]
        if ranges.x.shape[:-1] != time:
            raise InputError(
                f"subfields and rows must be of the same frames, "
                f"got {tuple(left_field.shape)} and {tuple(left_row.shape)}"
            )
        if isinstance(self.avoidance, RangingControl):
            command, avoidance, poses, pose = self.steer(self.avoidance, motion, ranges, state, driven)
            sides = motion.flatten(-2).amax(-1)
        else:
            sides = motion
            command, avoidance = self.avoidance(sides, state.avoidance if state else None)
            if driven is None:
                driven = Command(*(delayed(c, b) for c, b in zip(command, before(state, command), strict=True)))
            poses, pose = self.reckoning(driven.speed, driven.curvature, state.pose if state else None)
        last = Command(command.speed[..., -1], command.curvature[..., -1])
        now = Ranges(*(part[..., -1, :] for part in ranges))
        memory = (state.map, state.observations, state.tracks) if state else (None, None, None)
        state = NavigatorState(fields, rows, avoidance, last, pose, sides[..., -1, :], now, *memory)
        return command, state, ranges, poses

    def remember(self, state: NavigatorState, ranges: Ranges, poses: Pose) -> NavigatorState:
        """Fill the map, the observation list and the tracks, as far as there are any."""
        grid, seen, tracks = state.map, state.observations, state.tracks
        if self.grid_map is not None:
            _, grid = self.grid_map(ranges, poses, grid)
        if self.observations is not None:
            _, seen = self.observations(ranges, poses, seen)
        if self.tracker is not None:
            _, tracks = self.tracker(ranges, poses, tracks)
        return state._replace(map=grid, observations=seen, tracks=tracks)

    def mode(self, state: NavigatorState) -> Tensor:
        """What the controller is doing, `[...]`: `CRUISE`, `TURN`, `SUPPRESSED`, `STOPPED` or `REVERSE`."""
        mode: Tensor = self.avoidance.mode(state.avoidance)  # type: ignore[arg-type]
        return mode

    def steer(
        self,
        control: RangingControl,
        cells: Tensor,
        ranges: Ranges,
        state: NavigatorState | None,
        driven: Command | None,
    ) -> tuple[Command, RangingState, Pose, Pose]:
        """Frame by frame, because what is done at one frame is what was driven on the way to the next."""
        places, valid = torch.stack((ranges.x, ranges.y), -2), ranges.valid
        still = torch.zeros_like(ranges.x[..., 0, 0])
        pose = state.pose if state else Pose(still, still, still)
        mine = control.start(pose)
        if state is not None:
            assert isinstance(state.avoidance, RangingState)
            mine = state.avoidance
        last = state.command if state else Command(still, still)
        commands, poses = [], []
        for t in range(ranges.x.shape[-2]):
            if driven is not None:
                last = Command(driven.speed[..., t], driven.curvature[..., t])
            pose = self.reckoning.step(pose, last.speed, last.curvature)
            last, mine = control.step(cells[..., t, :, :, :], places[..., t, :, :], valid[..., t, :], pose, last, mine)
            commands.append(last)
            poses.append(pose)
        return (
            Command(*(torch.stack(parts, -1) for parts in zip(*commands, strict=True))),
            mine,
            Pose(*(torch.stack(parts, -1) for parts in zip(*poses, strict=True))),
            pose,
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
