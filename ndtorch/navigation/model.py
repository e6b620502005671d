"""The whole of navigation: two cameras in, speed and curvature out, and a map on the way."""

from __future__ import annotations

import operator

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_kind
from ndtorch.errors import InputError
from ndtorch.navigation.controllers.contract import Command, Controller
from ndtorch.navigation.controllers.registry import DEFAULT_CONTROLLER, make_controller
from ndtorch.navigation.correspondence import MatchParams
from ndtorch.navigation.features import FeatureParams
from ndtorch.navigation.localisation.localiser import Localiser
from ndtorch.navigation.localisation.state import frame_pose
from ndtorch.navigation.mapping import GridMap
from ndtorch.navigation.mapping.feature_tracks import AlphaBetaTracker
from ndtorch.navigation.mapping.map_rendering import log_ranges
from ndtorch.navigation.mapping.observations import ObservationList
from ndtorch.navigation.mapping.range_log import FramePose
from ndtorch.navigation.odometry import DeadReckoning, Pose
from ndtorch.navigation.one_frame import in_frames, take_over
from ndtorch.navigation.proximity.check import ProximityCheck
from ndtorch.navigation.proximity.schedule import ProximitySchedule
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import AngleModel, StereoRig
from ndtorch.navigation.row_ranging import RowRanging
from ndtorch.navigation.row_search import SearchParams
from ndtorch.navigation.state import NavigatorState, StepState, check_like, check_motion
from ndtorch.navigation.steering import Steering
from ndtorch.navigation.strips import Strips, row_rect, strips
from ndtorch.navigation.whole_step import Parts, Stepped, WholeStep


class Navigator(nn.Module):
    """Avoids obstacles and ranges what it passes: the architecture of [A] as one module.

    Any `Controller` can sit at its wheel: `"ranging"`, which drives where it has seen floor, `"published"`, the
    saccades of [A], or one of your own. Only two rectangles, which the controller chooses, and the two horizon
    rows are read. At the first frame the car is at the origin and stands still. In torch nearly all the time of a step
    goes into calling it, not into sums. Under `torch.inference_mode()` on a CPU kernels make the steps of one car.

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
        near_check: while one car stands, at the start or boxed in, look at what is right ahead with both cameras, and
            tell the controller; while it drives, search the right row for what stands wherever the controller wants it.
        localiser: corrects the poses at which these parts are filled, and tells the controller where the car is, so
            that it finds its goals; it steers by dead reckoning, which never jumps. None by default.

    Raises:
        InputError: an unknown controller, or parameters of the other one; frames that cannot be used: two sizes,
            grey beside color, NaN or infinity; what was driven, or a start, that is not finite.

    >>> from ndtorch.navigation import StereoRig
    >>> navigator = Navigator(StereoRig(), dt=1 / 30)
    >>> eyes = torch.randint(0, 256, (2, 1, 3, 480, 640), dtype=torch.uint8)
    >>> command, state = navigator(*eyes)
    >>> command.speed.shape, float(state.pose.x)
    (torch.Size([1]), 0.0)
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
        near_check: bool = False,
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
        self.whole: WholeStep | None = None
        # Where the ranging itself searches, the controller is told at every frame.
        looks = near_check and self.controller.looks_near
        searching = RowRanging(rig, dt, angles=angles, search=SearchParams(rows=1)) if search is None else None
        self.near = ProximitySchedule(ProximityCheck(rig, self.controller.fields), searching) if looks else None

    def forward(
        self,
        left: Tensor | Strips,
        right: Tensor | Strips,
        state: NavigatorState | None = None,
        driven: Command | None = None,
        start: Pose | None = None,
    ) -> tuple[Command, NavigatorState]:
        check_kind("state", state, NavigatorState)
        check_kind("driven", driven, Command)
        check_kind("start", start, Pose)
        try:
            return self.advance(left, right, state, driven, start)
        except InputError:
            raise
        except (RuntimeError, TypeError, ValueError, IndexError):
            # Looked at once it has failed: at every step that would take as long as some of what is computed.
            if state is not None:
                check_like(state, self.advance(left, right, None, None, None)[1])
            raise

    def advance(
        self,
        left: Tensor | Strips,
        right: Tensor | Strips,
        state: NavigatorState | None,
        driven: Command | None,
        start: Pose | None,
    ) -> tuple[Command, NavigatorState]:
        """`forward` with a state that is taken as it is."""
        ours, theirs = strips(left), strips(right)
        whole = self.whole_step()
        beginning = self.near.beginning(self.controller, ours, theirs) if self.near is not None else None
        step = whole(ours, theirs, state, driven, start, beginning)
        if step is not None:
            return self.after(step, ours, theirs, state)
        command, state, ranges, poses, frames = self.see_and_steer(left, right, state, driven, start)
        return command, self.remember(state, ranges, poses, frames)

    def whole_step(self) -> WholeStep:
        """Steps of the parts that there are now."""
        parts = Parts(self.controller, self.ranging, self.reckoning)
        if self.whole is None or not all(map(operator.is_, self.whole.parts, parts)):
            self.whole = WholeStep(parts)
        return self.whole

    def steering(self) -> Steering:
        """What steers frame by frame, of the parts that there are now."""
        size = (self.ranging.rig.height, self.ranging.rig.width)
        return Steering(self.controller, self.reckoning, self.near, self.localiser, self.row, size)

    def after(
        self, step: Stepped, left: Strips, right: Strips, state: NavigatorState | None
    ) -> tuple[Command, NavigatorState]:
        """Command and state after a step that one kernel made: what the controller is to be careful of, and memory."""
        new, packed, command, careful = step
        whole = True
        if careful:
            ahead, control = self.controller.caution(new.command, new.control, new.pose)
            if ahead is not new.command:
                new, whole = new._replace(command=ahead, control=control), False
                command = Command(ahead.speed.unsqueeze(0), ahead.curvature.unsqueeze(0))
        if self.near is not None and not new.pose.x.ndim:
            told = self.near.while_driving(self.controller, new.control, new.pose, (left.row[0], right.row[0]))
            if told is not new.control and whole and self.controller.quick is not None:
                # Nobody else has this state yet: so what the next step goes on from stays in one piece.
                take_over(self.controller.quick.take(new.control), self.controller.quick.take(told))
            elif told is not new.control:
                new, whole = new._replace(control=told), False
        if self.localiser is not None:
            before = state.located if state else None
            new = new._replace(located=self.steering().locate(left.row, right.row, new.pose, before))
        if self.grid_map or self.observations or self.tracker:
            frames = None if new.located is None else [frame_pose(new.located)]
            new = self.remember(new, *in_frames(new.ranges, new.place), frames)
        if whole:
            new = StepState(*new)
            new.packed = packed
        return command, new

    def see_and_steer(
        self,
        left: Tensor | Strips,
        right: Tensor | Strips,
        state: NavigatorState | None = None,
        driven: Command | None = None,
        start: Pose | None = None,
    ) -> tuple[Command, NavigatorState, Ranges, Pose, list[FramePose | None] | None]:
        """All but the memory: command, state, and the ranges, places and frame poses of every frame for `remember`."""
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
        eyes = (left_field, right_field), (left_row, right_row)
        command, control, poses, pose, located, frames = self.steering().steer(seen, ranges, state, driven, start, eyes)
        sides, difference = self.controller.sides(seen), self.controller.difference(control)
        last = Command(command.speed[..., -1], command.curvature[..., -1])
        now = Ranges(*(part[..., -1, :] for part in ranges))
        memory = (state.map, state.observations, state.tracks) if state else (None, None, None)
        state = NavigatorState(fields, rows, control, last, pose, sides[..., -1, :], difference, now, *memory, located)
        return command, state, ranges, poses, frames

    def remember(
        self, state: NavigatorState, ranges: Ranges, poses: Pose, frames: list[FramePose | None] | None = None
    ) -> NavigatorState:
        """Fill the map, the observation list and the tracks, as far as there are any.

        Args:
            frames: poses of the frames in frames of the map that the localiser moves; None without a localiser.
        """
        grid, seen, tracks = state.map, state.observations, state.tracks
        if self.grid_map is not None:
            grid = self.grid_map.update(ranges, poses, grid)
            if frames is not None:
                grid = log_ranges(grid, ranges, frames)
        if self.observations is not None:
            _, seen = self.observations(ranges, poses, seen)
        if self.tracker is not None:
            _, tracks = self.tracker(ranges, poses, tracks)
        return state._replace(map=grid, observations=seen, tracks=tracks)

    def warm_up(self, frame: Tensor | None = None) -> None:
        """Have the kernels ready that steps under `torch.inference_mode()` use, before a car depends on them.

        The first time they are compiled, which takes some seconds; later they are loaded.

        Args:
            frame: one like those that will come, `[1, C, H, W]`; kernels differ with its dtype and its layout. By
                default a color picture as OpenCV has it, uint8, the colors of a pixel beside each other.
        """
        if frame is None:
            height, width = self.ranging.rig.height, self.ranging.rig.width
            frame = torch.zeros(1, height, width, 3, dtype=torch.uint8).permute(0, 3, 1, 2)
        with torch.inference_mode():
            _, state = self(frame, frame)
            self(frame, frame, state)
            if self.near is not None:
                self.near.warm_up(self.controller, frame, state)
            self.controller.warm_up()
            for memory in (self.grid_map, self.localiser):
                if memory is not None:
                    memory.warm_up()

    def mode(self, state: NavigatorState) -> Tensor:
        """What the controller is doing, `[...]`: one of its `modes`, `CRUISE`, `TURN`, ..."""
        return self.controller.mode(state.control)
