"""The whole of navigation: two cameras in, speed and curvature out, and a map beside it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from ndtorch.arguments import check_kind
from ndtorch.errors import InputError
from ndtorch.navigation.body import Body, match_params, proximity_params, rig_in_units, search_params
from ndtorch.navigation.controllers.contract import Command, Controller
from ndtorch.navigation.controllers.registry import DEFAULT_CONTROLLER, make_controller
from ndtorch.navigation.controllers.scaled import controller_for_body
from ndtorch.navigation.localisation.localiser import Localiser, LocaliserState
from ndtorch.navigation.mapping import GridMap
from ndtorch.navigation.mapping.feature_tracks import AlphaBetaTracker
from ndtorch.navigation.mapping.grid_map import in_tensors
from ndtorch.navigation.mapping.observations import ObservationList
from ndtorch.navigation.odometry import DeadReckoning, Pose
from ndtorch.navigation.proximity.check import ProximityCheck, ProximitySchedule
from ndtorch.navigation.state import (
    NavigatorState,
    all_cars,
    check_cars,
    check_known,
    check_like,
    check_motion,
    one_car,
    pose_like,
)
from ndtorch.navigation.stereo.correspondence import MatchParams
from ndtorch.navigation.stereo.features import FeatureParams
from ndtorch.navigation.stereo.ranging import Ranges, StereoRanging, StereoRangingState
from ndtorch.navigation.stereo.rig import AngleModel, StereoRig
from ndtorch.navigation.stereo.search import SearchParams
from ndtorch.navigation.stereo.strips import Strips, as_frames, check_eyes, grey_pair, row_rect, strips


class Navigator(nn.Module):
    """Avoids obstacles and ranges what it passes: the architecture of [A] as one module.

    Any `Controller` can steer: `"ranging"`, which drives where it has seen floor, `"published"`, the
    saccades of [A], or one of your own. Only two rectangles, which the controller chooses, and the two horizon
    rows are read. At the first frame the car is at the origin and stands still.

    Compiled steps (`backend="numba"`) take frames on the CPU and go through the cars of a batch one after the other;
    their state holds arrays and numbers. `backend="torch"` steps whole batches on any device, with gradients: only the
    controller `"published"` and your own have it.

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
        search: parameters of the search of the right row, by which is ranged for controllers that check what is near,
            unless `features` or `matching` is given.
        features, matching: parameters of the matching of features, as [A] and the controller `"published"` range.
        angles: `"atan"` (exact) or `"linear"` (as published).
        grid_map, observations, tracker: parts to fill with the ranges; none by default.
        backend: `"numba"`, `"torch"`, or `"auto"`: the first of them that the controller has.
        near_check: with compiled steps, a car that stands, at the start or boxed in, checks what is right ahead with
            both cameras after its command, and one that drives searches the right row for its controller. False is for
            images in which there is no floor.
        localiser: corrects the poses at which these parts are filled, and gives the controller the car's pose in the
            map, so that it finds its goals; it steers by dead reckoning, which never jumps. None by default.
        body: the robot's, which all lengths and speeds of a controller that is named follow, and the disparities that
            are ranged; the car of [A] by default.

    Raises:
        InputError: an unknown controller, one without this backend, or parameters of another one; frames that cannot be
            used: two sizes, grey beside color, NaN or infinity; what was driven, or a start, that is not finite.

    >>> from ndtorch.navigation import StereoRig
    >>> navigator = Navigator(StereoRig(), dt=1 / 30)
    >>> frames = torch.randint(0, 256, (2, 1, 3, 480, 640), dtype=torch.uint8)
    >>> command, state = navigator(*frames)
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
        backend: str = "auto",
        near_check: bool = True,
        localiser: Localiser | None = None,
        body: Body | None = None,
    ) -> None:
        super().__init__()
        if isinstance(controller, str):
            if body is None:
                controller = make_controller(controller, rig, dt, params, backend)
            else:
                controller = controller_for_body(controller, rig, dt, body, params, backend)
        elif body is not None:
            raise InputError("body belongs to a controller that is named; this one was made already")
        elif params is not None:
            raise InputError("params belong to a controller that is named; this one was made already")
        if backend not in ("auto", controller.backend):
            raise InputError(f"this controller has the backend {controller.backend!r}, got backend={backend!r}")
        self.controller: Controller = controller
        self.backend = controller.backend
        how = SearchParams(rows=1) if body is None else search_params(rig, body)
        if search is None and features is None and matching is None and self.controller.checks_near:
            search = how
        matching = match_params(rig, body) if matching is None and body is not None else matching
        self.ranging = StereoRanging(rig, dt, features, matching, angles, search=search)
        self.reckoning = DeadReckoning(dt)
        self.grid_map, self.observations, self.tracker, self.localiser = grid_map, observations, tracker, localiser
        self.has_memory = not (grid_map is None and observations is None and tracker is None)
        self.row = row_rect(rig)
        # Where the ranging itself searches, the controller is told at every frame.
        looks = near_check and self.backend == "numba" and self.controller.checks_near
        searching = StereoRanging(rig, dt, angles=angles, search=how) if search is None else None
        fields = self.controller.fields
        near, unit_m = ProximityCheck(rig, fields), 1.0
        if body is not None:
            unit_m = body.unit_m
            near = ProximityCheck(rig_in_units(rig, unit_m), fields, proximity_params(rig, body))
        self.near = ProximitySchedule(near, searching, unit_m) if looks else None

    def extra_repr(self) -> str:
        """The backend."""
        return f"backend={self.backend!r}"

    def forward(
        self,
        left: Tensor | Strips,
        right: Tensor | Strips,
        state: NavigatorState | None = None,
        driven: Command | None = None,
        start: Pose | None = None,
    ) -> tuple[Command, NavigatorState]:
        command, complete = self.command_first(left, right, state, driven, start)
        return command, complete()

    def command_first(
        self,
        left: Tensor | Strips,
        right: Tensor | Strips,
        state: NavigatorState | None = None,
        driven: Command | None = None,
        start: Pose | None = None,
    ) -> tuple[Command, Callable[[], NavigatorState]]:
        """The command, and what returns the state: map, localiser and checks for the next command take their time
        after this one. Arguments, command and state are those of a call of the module.
        """
        check_kind("state", state, NavigatorState)
        check_kind("driven", driven, Command)
        check_kind("start", start, Pose)
        ours, theirs = strips(left), strips(right)
        shape = frames_shape(ours, theirs)
        if driven is not None or start is not None:
            check_motion(driven, start, shape)

        def explain(error: Exception) -> None:
            # Looked at once it has failed: at every step that would take as long as some of what is computed.
            if state is not None and not isinstance(error, InputError):
                check_like(state, self.frame_by_frame(ours, theirs, None, None, None, shape)[1]())

        def complete() -> NavigatorState:
            try:
                return rest()
            except Exception as error:
                explain(error)
                raise

        try:
            if state is not None:
                check_known(state)
            command, rest = self.frame_by_frame(ours, theirs, state, driven, start, shape)
        except Exception as error:
            explain(error)
            raise
        return command, complete

    def frame_by_frame(
        self,
        left: Strips,
        right: Strips,
        state: NavigatorState | None,
        driven: Command | None,
        start: Pose | None,
        shape: tuple[int, ...],
    ) -> tuple[Command, Callable[[], NavigatorState]]:
        """Frame by frame, because what is done at one frame is what was driven on the path to the next."""
        if self.backend == "numba":
            if state is not None:
                check_cars(state, shape[:-1])
            if len(shape) > 1:
                return self.car_by_car(left, right, state, driven, start, shape)
            start = None if start is None else Pose(*map(float, start))
        commands = []
        rest: Callable[[], NavigatorState] | None = None
        for ours, theirs, moved in self.frames(left, right, driven, shape[-1]):
            command, rest = self.decide(ours, theirs, state if rest is None else rest(), moved, start)
            commands.append(command)
        assert rest is not None
        speed, curvature = zip(*commands, strict=True)
        made = as_tensor if self.backend == "numba" else in_time
        return Command(made(speed), made(curvature)), rest

    def frames(
        self, left: Strips, right: Strips, driven: Command | None, count: int
    ) -> list[tuple[Strips, Strips, Command | None]]:
        """The frames one after the other, `[C, H, W]` or `[..., 1, C, H, W]`, and what was driven to each."""
        if self.backend == "torch":
            eyes = ([Strips(*(part.narrow(-4, t, 1) for part in eye)) for t in range(count)] for eye in (left, right))
            moved = [None if driven is None else Command(*(part[..., t] for part in driven)) for t in range(count)]
            return list(zip(*eyes, moved, strict=True))
        one = count == 1
        ours, theirs = ((eye.field[0],) if one else eye.field.unbind(0) for eye in (left, right))
        whole = left.row is left.field and right.row is right.field
        rows = (ours, theirs) if whole else (left.row.unbind(0), right.row.unbind(0))
        told = [None] * count if driven is None else list(map(Command, *(part.tolist() for part in driven)))
        return list(zip(map(Strips, ours, rows[0]), map(Strips, theirs, rows[1]), told, strict=True))

    def car_by_car(
        self,
        left: Strips,
        right: Strips,
        state: NavigatorState | None,
        driven: Command | None,
        start: Pose | None,
        shape: tuple[int, ...],
    ) -> tuple[Command, Callable[[], NavigatorState]]:
        """The compiled steps of a batch."""
        batch, dims, made = shape[:-1], len(shape) - 1, []
        for n in range(math.prod(batch)):
            ours, theirs, before, moved, begun = (
                one_car(part, n, dims) for part in (left, right, state, driven, start)
            )
            made.append(self.frame_by_frame(ours, theirs, before, moved, begun, shape[-1:]))
        commands, rests = zip(*made, strict=True)
        return all_cars(list(commands), batch), lambda: all_cars([rest() for rest in rests], batch)

    def decide(
        self, left: Strips, right: Strips, state: NavigatorState | None, driven: Command | None, start: Pose | None
    ) -> tuple[Command, Callable[[], NavigatorState]]:
        """One frame of each camera: see, range, remember, decide and limit; and what is done once that is commanded."""
        # Looked up once: `nn.Module` takes a microsecond for each.
        modules: Any = self._modules
        controller, reckoning, near = modules["controller"], modules["reckoning"], self.near
        fields, rows = self.read(left, right)
        seen, field_filters = controller.see(fields, None if state is None else state.fields)
        ranges, row_filters = self.range(rows, None if state is None else state.rows)
        begins, before = state is None or state.fields is None, state or self.begin(seen, ranges, start)
        last = before.command if driven is None else driven
        pose, control, located = reckoning.step(before.pose, *last), before.control, before.located
        here = pose
        if self.localiser is not None and controller.has_goals:
            located = self.locate(left.row, right.row, pose, located)
            here = self.control_pose(pose, located)
            control = controller.on_pose(control, here, pose_like(pose, located.pose))
        command, control = controller.step(seen, ranges, here, last, control)
        if near is not None and begins:
            command = Command(0.0, 0.0)  # what is near is not checked yet

        def complete() -> NavigatorState:
            at, after = located, control
            if near is not None:
                after = near.while_standing(controller, after, last, here, left, right, ranges, begins)
                after = near.while_driving(controller, after, here, (left.row, right.row))
            if self.localiser is not None and not controller.has_goals:
                at = self.locate(left.row, right.row, pose, at)
            sides, difference = controller.sides(seen), controller.difference(after)
            memory = (before.map, before.observations, before.tracks, at)
            now = (field_filters, row_filters, after, command, pose, sides, difference, ranges)
            return self.fill_map(NavigatorState(*now, *memory))

        return command, complete

    def read(self, left: Strips, right: Strips) -> tuple[Any, Any]:
        """Fields and rows of both cameras, as the backend takes them."""
        if self.backend == "torch":
            return (left.field, right.field), (left.row, right.row)
        fields = as_frames(left.field, right.field)
        return fields, fields if left.row is left.field else as_frames(left.row, right.row)

    def range(self, rows: Any, state: StereoRangingState | None) -> tuple[Ranges, StereoRangingState]:
        """Ranges of one frame."""
        ranging: Any = self._modules["ranging"]
        if self.backend == "numba":
            found: tuple[Ranges, StereoRangingState] = ranging.step(rows, state)
            return found
        ranges, state = ranging(*rows, state)
        return Ranges(*(part[..., 0, :] for part in ranges)), state

    def begin(self, seen: Any, ranges: Ranges, start: Pose | None) -> NavigatorState:
        """The state before the first frame: the car stands."""
        still = torch.zeros_like(ranges.x[..., 0]) if self.backend == "torch" else 0.0
        pose = Pose(still, still, still) if start is None else start
        control = self.controller.start(seen, pose)
        return NavigatorState(None, None, control, Command(still, still), pose, None, still, ranges, None, None, None)

    def locate(self, left: Tensor, right: Tensor, pose: Pose, located: LocaliserState | None) -> LocaliserState:
        """The localiser's state with the corrected pose of a frame."""
        assert self.localiser is not None
        rows = None
        if self.localiser.due(located):
            size = (self.ranging.rig.height, self.ranging.rig.width)
            ours, theirs = (row if row.ndim == 4 else row.unsqueeze(0) for row in (left, right))
            rows = grey_pair(ours, theirs, self.row, self.row, size).squeeze(-2)[0]
        return self.localiser(rows, pose, located)

    def control_pose(self, pose: Pose, located: LocaliserState | None) -> Pose:
        """Where the car is in the frame of its controller, which never jumps: by dead reckoning.

        A controller that plans in what it saw minutes ago takes that of the localiser, which sees where wheels slip.
        """
        return pose if located is None or not self.controller.has_goals else pose_like(pose, located.odometry)

    def fill_map(self, state: NavigatorState) -> NavigatorState:
        """Fill the map, the observation list and the tracks, as far as there are any."""
        if not self.has_memory:
            return state
        ranges, poses = state.ranges, state.place
        grid, seen, tracks = state.map, state.observations, state.tracks
        if self.backend == "torch":
            ranges, poses = Ranges(*(part.unsqueeze(-2) for part in ranges)), Pose(*(x.unsqueeze(-1) for x in poses))
        if self.grid_map is not None:
            grid = self.grid_map.update(ranges, poses, grid)
        if self.backend == "numba" and (self.observations or self.tracker):
            ranges, poses = in_tensors(ranges, poses)
        if self.observations is not None:
            _, seen = self.observations(ranges, poses, seen)
        if self.tracker is not None:
            _, tracks = self.tracker(ranges, poses, tracks)
        return state._replace(map=grid, observations=seen, tracks=tracks)

    def warm_up(self, frame: Tensor | None = None) -> None:
        """Compile the steps, or load what was compiled before, before a car depends on them.

        The first time takes about 40 s, on two processors less: they compile side by side.

        Args:
            frame: one like those that will come, `[1, C, H, W]`; compiled steps differ with its dtype and its layout.
                By default a color image as OpenCV has it, uint8, the colors of a pixel beside each other.
        """
        if self.backend == "torch":
            return
        if frame is None:
            height, width = self.ranging.rig.height, self.ranging.rig.width
            frame = torch.zeros(1, height, width, 3, dtype=torch.uint8).permute(0, 3, 1, 2)
        if self.controller.checks_near and self.ranging.searched is not None:
            self.warm_up_senses(frame)
        _, state = self(frame, frame)
        self(frame, frame, state)
        self.warm_up_senses(frame)
        if self.localiser is not None:
            self.localiser.warm_up()

    def warm_up_senses(self, frame: Tensor) -> None:
        """Compile or load what ranges, what checks what is near, and what the controller needs later."""
        self.ranging.step(as_frames(frame[0], frame[0]), None)
        if self.near is not None:
            self.near.warm_up(frame[0])
        self.controller.warm_up()

    def mode(self, state: NavigatorState) -> Any:
        """What the controller is doing, `[...]`: one of its `modes`, `CRUISE`, `TURN`, ..."""
        if self.backend == "torch" or isinstance(state.pose.x, float):
            return self.controller.mode(state.control)
        cars = state.pose.x.shape
        modes = [self.controller.mode(one_car(state.control, n, len(cars))) for n in range(state.pose.x.size)]
        return all_cars(modes, cars)


def frames_shape(left: Strips, right: Strips) -> tuple[int, ...]:
    """Leading dimensions `[..., T]` of the frames.

    Raises:
        InputError: strips of different frames, or none.
    """
    eyes = (left.field, right.field) if left.row is left.field and right.row is right.field else (*left, *right)
    if not all(isinstance(part, Tensor) for part in eyes):
        check_eyes(left.field, right.field)
        check_eyes(left.row, right.row)
    shape = eyes[0].shape
    if len(shape) < 4 or not shape[-4]:
        raise InputError(f"expected frames [..., T, C, H, W] with T >= 1, got {tuple(shape)}")
    lead = shape[:-3]
    for part in eyes[1:]:
        if part.shape != shape and part.shape[:-3] != lead:
            raise InputError(
                f"subfields and rows must be of the same frames, got {tuple(shape)} and {tuple(part.shape)}"
            )
    return lead


def as_tensor(values: Sequence[float]) -> Tensor:
    return torch.from_numpy(np.array(values, np.float32))


def in_time(values: Sequence[Tensor]) -> Tensor:
    """Values `[...]` of frame after frame as `[..., T]`."""
    return torch.stack(list(values), -1)
