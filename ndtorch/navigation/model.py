"""The whole of navigation: two cameras in, speed and curvature out, and a map on the way."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_tensor
from ndtorch.errors import InputError
from ndtorch.navigation.controllers.contract import Command, Controller, in_time, ranges_at, stack_commands
from ndtorch.navigation.controllers.registry import DEFAULT_CONTROLLER, make_controller
from ndtorch.navigation.correspondence import MatchParams
from ndtorch.navigation.features import FeatureParams
from ndtorch.navigation.localisation.localiser import Localiser, LocaliserState
from ndtorch.navigation.mapping import GridMap, GridMapState
from ndtorch.navigation.observations import ObservationList, Observations
from ndtorch.navigation.odometry import DeadReckoning, Pose
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import AngleModel, StereoRig
from ndtorch.navigation.row_ranging import RowRanging, RowRangingState
from ndtorch.navigation.row_search import SearchParams
from ndtorch.navigation.strips import Strips, grey_pair, row_rect
from ndtorch.navigation.tracking import AlphaBetaTracker, Tracks
from ndtorch.navigation.whole_step import Going, Parts, Stepped, in_frames, whole_step
from ndtorch.vision.temporal import FilterState


class NavigatorState(NamedTuple):
    """State of `Navigator`, and what it last saw.

    Attributes:
        fields, rows: states of what reads the subfields and the horizon rows.
        control: the controller's own state, a NamedTuple of tensors.
        command: the last command, `[...]`, driven until the next frame.
        pose: where the car was at the last frame by dead reckoning, `[...]`; `place` is the corrected one.
        sides: speed estimates of the last frame, `[..., 2]`.
        difference: what the controller weighed then, `[...]`; `Controller.trace` says what it is.
        ranges: of the last frame, `[..., n]`.
        map, observations, tracks, located: states of those parts, None where the navigator has none.
    """

    fields: FilterState
    rows: RowRangingState
    control: Any
    command: Command
    pose: Pose
    sides: Tensor
    difference: Tensor
    ranges: Ranges
    map: GridMapState | None
    observations: Observations | None
    tracks: Tracks | None
    located: LocaliserState | None = None

    @property
    def place(self) -> Pose:
        """Where the car was at the last frame as far as is known, `[...]`: corrected where there is a localiser."""
        return self.pose if self.located is None else Pose(*(part.to(self.pose.x) for part in self.located.pose))


class Navigator(nn.Module):
    """Avoids obstacles and ranges what it passes: the architecture of [A] as one module.

    Any `Controller` can sit at its wheel: `"ranging"`, which drives where it has seen floor, `"published"`, the
    saccades of [A], or one of your own. Only two rectangles, which the controller chooses, and the two horizon
    rows are read. At the first frame the car is at the origin and stands still. Nearly all the time of a step goes
    into calling torch, not into sums: it takes a fifth less under `torch.inference_mode()`, and a batch of 64 cars
    takes four times as long as one.

    Shapes:
        left, right: frames `[..., T, C, H, W]` of the two cameras, uint8 or float in 0..1, C = 3 (RGB) or 1,
            or `Strips` cut out of them.
        driven: what the car really did on the way to each frame, `Command` of `[..., T]`; by default the
            command given at the frame before.
        start: where the car stands at the first frame, `Pose` of `[...]`; the origin by default.
        command: `Command` of `[..., T]`, what to do from each frame on.

    Args:
        rig: the camera pair.
        dt: time step, s.
        controller: the name of a controller (`controller_names`), or one that was made for this rig and step.
        params: parameters of the controller that is named, an instance of its `Params`.
        search: range by searching the right row instead of matching features.
        features, matching: parameters of the ranging. `FeatureParams(7, edge_reach=4, shared=True)` ranges better
            than the published default.
        angles: `"atan"` (exact) or `"linear"` (as published).
        grid_map, observations, tracker: parts to fill with the ranges; none by default.
        localiser: corrects the poses at which these parts are filled; the controller steers by dead reckoning,
            which never jumps. None by default.

    Raises:
        InputError: an unknown controller, or parameters of the other one; frames that cannot be used: two sizes,
            grey beside color, NaN or infinity; what was driven, or a start, that is not finite.
    """

    def __init__(
        self,
        rig: StereoRig,
        dt: float,
        *,
        controller: str | Controller = DEFAULT_CONTROLLER,
        params: object | None = None,
        features: FeatureParams | None = None,
        matching: MatchParams | None = None,
        angles: AngleModel = "atan",
        search: SearchParams | None = None,
        grid_map: GridMap | None = None,
        observations: ObservationList | None = None,
        tracker: AlphaBetaTracker | None = None,
        localiser: Localiser | None = None,
    ) -> None:
        super().__init__()
        if isinstance(controller, str):
            controller = make_controller(controller, rig, dt, params)
        elif params is not None:
            raise InputError("params belong to a controller that is named; this one was made already")
        self.controller: Controller = controller
        self.ranging = RowRanging(rig, dt, features, matching, angles, search=search)
        self.reckoning = DeadReckoning(dt)
        self.grid_map, self.observations, self.tracker, self.localiser = grid_map, observations, tracker, localiser
        self.row = row_rect(rig)

    def forward(
        self,
        left: Tensor | Strips,
        right: Tensor | Strips,
        state: NavigatorState | None = None,
        driven: Command | None = None,
        start: Pose | None = None,
    ) -> tuple[Command, NavigatorState]:
        ours, theirs = strips(left), strips(right)
        parts = Parts(self.controller, self.ranging, self.reckoning)
        step = whole_step(parts, ours, theirs, Going(*state[:5]) if state else None, driven, start)
        if step is not None:
            return step.command, self.after(step, ours, theirs, state)
        command, state, ranges, poses = self.see_and_steer(left, right, state, driven, start)
        return command, self.remember(state, ranges, poses)

    def after(self, step: Stepped, left: Strips, right: Strips, state: NavigatorState | None) -> NavigatorState:
        """The state after a step that one kernel made: it remembers what was seen."""
        memory = state[8:] if state else (None, None, None, None)
        difference = self.controller.difference(step.control)
        new = NavigatorState(*step.going, step.sides, difference, step.ranges, *memory)
        if not any((self.grid_map, self.observations, self.tracker, self.localiser)):
            return new
        ranges, poses = in_frames(step)
        if self.localiser is not None:
            located, poses = self.locate(self.localiser, left.row, right.row, poses, state)
            new = new._replace(located=located)
        return self.remember(new, ranges, poses)

    def see_and_steer(
        self,
        left: Tensor | Strips,
        right: Tensor | Strips,
        state: NavigatorState | None = None,
        driven: Command | None = None,
        start: Pose | None = None,
    ) -> tuple[Command, NavigatorState, Ranges, Pose]:
        """All but the memory: command, state, and the ranges and places of every frame, which `remember` takes."""
        check_motion(driven, start)
        left_field, left_row = strips(left)
        right_field, right_row = strips(right)
        seen, fields = self.controller.see(left_field, right_field, state.fields if state else None)
        ranges, rows = self.ranging(left_row, right_row, state.rows if state else None)
        if seen.shape[: ranges.x.ndim - 1] != ranges.x.shape[:-1]:
            raise InputError(
                f"subfields and rows must be of the same frames, "
                f"got {tuple(left_field.shape)} and {tuple(left_row.shape)}"
            )
        command, control, poses, pose = self.steer(seen, ranges, state, driven, start)
        sides, difference = self.controller.sides(seen), self.controller.difference(control)
        last = Command(command.speed[..., -1], command.curvature[..., -1])
        now = Ranges(*(part[..., -1, :] for part in ranges))
        memory = (state.map, state.observations, state.tracks) if state else (None, None, None)
        located = None
        if self.localiser is not None:
            located, poses = self.locate(self.localiser, left_row, right_row, poses, state)
        state = NavigatorState(fields, rows, control, last, pose, sides[..., -1, :], difference, now, *memory, located)
        return command, state, ranges, poses

    def locate(
        self, localiser: Localiser, left: Tensor, right: Tensor, poses: Pose, state: NavigatorState | None
    ) -> tuple[LocaliserState | None, Pose]:
        """Correct the poses `[T]` of frames, one after the other."""
        located, corrected = state.located if state else None, []
        for t in range(poses.x.shape[-1]):
            rows = None
            if localiser.due(located):
                now = [eye[..., t : t + 1, :, :, :] for eye in (left, right)]
                size = (self.ranging.rig.height, self.ranging.rig.width)
                rows = grey_pair(now[0], now[1], self.row, self.row, size).squeeze(-2)[..., 0, :, :]
            located = localiser(rows, Pose(*(part[..., t] for part in poses)), located)
            corrected.append(located.pose)
        return located, Pose(*(in_time(parts).to(poses.x) for parts in zip(*corrected, strict=True)))

    def remember(self, state: NavigatorState, ranges: Ranges, poses: Pose) -> NavigatorState:
        """Fill the map, the observation list and the tracks, as far as there are any."""
        grid, seen, tracks = state.map, state.observations, state.tracks
        if self.grid_map is not None:
            grid = self.grid_map.update(ranges, poses, grid)
        if self.observations is not None:
            _, seen = self.observations(ranges, poses, seen)
        if self.tracker is not None:
            _, tracks = self.tracker(ranges, poses, tracks)
        return state._replace(map=grid, observations=seen, tracks=tracks)

    def warm_up(self) -> None:
        """Have the kernels ready that steps under `torch.inference_mode()` use, before a car depends on them.

        The first time they are compiled, which takes some seconds; later they are loaded.
        """
        blank = torch.zeros(1, 1, self.ranging.rig.height, self.ranging.rig.width, dtype=torch.uint8)
        with torch.inference_mode():
            _, state = self(blank, blank)
            self(blank, blank, state)
            self.controller.warm_up()

    def mode(self, state: NavigatorState) -> Tensor:
        """What the controller is doing, `[...]`: one of its `modes`, `CRUISE`, `TURN`, ..."""
        return self.controller.mode(state.control)

    def steer(
        self,
        seen: Tensor,
        ranges: Ranges,
        state: NavigatorState | None,
        driven: Command | None,
        start: Pose | None = None,
    ) -> tuple[Command, Any, Pose, Pose]:
        """Frame by frame, because what is done at one frame is what was driven on the way to the next."""
        still = torch.zeros_like(ranges.x[..., 0, 0])
        pose = state.pose if state else start or Pose(still, still, still)
        last = state.command if state else Command(still, still)
        dim = ranges.x.ndim - 2
        control = state.control if state else self.controller.start(seen.select(dim, 0), pose)
        commands, poses = [], []
        for t in range(ranges.x.shape[-2]):
            if driven is not None:
                last = Command(driven.speed[..., t], driven.curvature[..., t])
            pose = self.reckoning.step(pose, last.speed, last.curvature)
            last, control = self.controller.step(seen.select(dim, t), ranges_at(ranges, t), pose, last, control)
            commands.append(last)
            poses.append(pose)
        return (
            stack_commands(commands),
            control,
            Pose(*(in_time(parts) for parts in zip(*poses, strict=True))),
            pose,
        )


def check_motion(driven: Command | None, start: Pose | None) -> None:
    """Raise `InputError` for what was driven, or a start, that is not finite: it would stay in the pose for good."""
    for name, given, kind in (("driven", driven, Command), ("start", start, Pose)):
        if given is None:
            continue
        if not isinstance(given, kind):
            raise InputError(f"{name} must be a {kind.__name__}, got {type(given).__name__}")
        for part, value in zip(kind._fields, given, strict=True):
            check_tensor(f"{name}.{part}", value)
            if name == "driven" and value.ndim < 1:
                raise InputError(f"{name}.{part} must be [..., T], got a single number")


def strips(eye: Tensor | Strips) -> Strips:
    """Whole frames stand for both of their strips: each step cuts its own."""
    return eye if isinstance(eye, Strips) else Strips(eye, eye)
