"""The whole of navigation: two cameras in, speed and curvature out, and a map beside it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ndtorch.errors import InputError
from ndtorch.navigation.body import Body
from ndtorch.navigation.controllers.contract import (
    DEFAULT_CONTROLLER,
    STOPPED,
    SUPPRESSED,
    Command,
    Controller,
    make_controller,
)
from ndtorch.navigation.localisation.localiser import Localiser, LocaliserState
from ndtorch.navigation.mapping.grid_map import GridMap, GridMapState
from ndtorch.navigation.mapping.observations import AlphaBetaTracker, FeatureTracks, ObservationList, Observations
from ndtorch.navigation.odometry import DeadReckoning, Pose
from ndtorch.navigation.proximity import Obstacles, ProximityCheck
from ndtorch.navigation.stereo._kernels import Frames, grey_fields
from ndtorch.navigation.stereo.features import FeatureParams, MatchParams
from ndtorch.navigation.stereo.ranging import Ranges, StereoRanging
from ndtorch.navigation.stereo.rig import AngleModel, StereoRig
from ndtorch.navigation.stereo.search import SearchParams
from ndtorch.navigation.stereo.strips import Strips, as_frames, at_rects, row_rect

STATIONARY = 0.05  # a slower car is stationary, m/s


class NavigatorState(NamedTuple):
    """State of `Navigator`, and what it last saw: tensors, or arrays and numbers where the backend is `"numba"`.

    Attributes:
        fields, rows: states of what reads the subfields and the horizon rows; None has them settle on the next frame.
        control: the controller's own state, a NamedTuple.
        command: the last command, `[...]`, driven until the next frame.
        pose: where the car was at the last frame by dead reckoning, `[...]`; `place` is the corrected one.
        sides: speed estimates of the last frame, `[..., 2]`.
        difference: what the controller weighed then, `[...]`.
        ranges: of the last frame, `[..., n]`.
        map, observations, tracks, located: states of those parts, None where the navigator has none.
        seen: what a compiled controller steered by at the last frame, an array; else None.
    """

    fields: Any
    rows: Any
    control: Any
    command: Command
    pose: Pose
    sides: Any
    difference: Any
    ranges: Ranges
    map: GridMapState | None
    observations: Observations | None
    tracks: FeatureTracks | None
    located: LocaliserState | None = None
    seen: Any = None

    @property
    def place(self) -> Pose:
        """Where the car was at the last frame as far as is known, `[...]`: corrected where there is a localiser."""
        return self.pose if self.located is None else Pose(*self.located.pose.tolist())


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
            both cameras after its command. False is for images in which there is no floor.
        localiser: corrects the poses at which these parts are filled, and gives the controller the car's pose in the
            map, so that it finds its goals; it steers by dead reckoning, which never jumps. Compiled steps only.
        body: the robot's, which all lengths and speeds of a controller that is named follow, and the disparities that
            are ranged; the car of [A] by default.

    Raises:
        InputError: an unknown controller, one without this backend, or parameters of another one; frames that cannot be
            used: two sizes, grey beside color, NaN or infinity; a state of another module.

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
            controller = make_controller(controller, rig, dt, params, backend, body)
        elif body is not None or params is not None:
            raise InputError("body and params belong to a controller that is named; this one was made already")
        elif backend not in ("auto", controller.backend):
            raise InputError(f"this controller has the backend {controller.backend!r}, got backend={backend!r}")
        if localiser is not None and controller.backend == "torch":
            raise InputError("a localiser goes with compiled steps, backend='numba'")
        self.controller: Controller = controller
        self.backend = controller.backend
        body, self.size = Body() if body is None else body, (rig.height, rig.width)
        self.unit_m = body.unit_m
        if search is None and features is None and matching is None and controller.checks_near:
            search = SearchParams.for_body(rig, body)
        matching = MatchParams.for_body(rig, body) if matching is None else matching
        self.ranging = StereoRanging(rig, dt, features, matching, angles, search=search)
        self.reckoning, self.row = DeadReckoning(dt), row_rect(rig)
        self.grid_map, self.observations, self.tracker, self.localiser = grid_map, observations, tracker, localiser
        self.near: ProximityCheck | None = None
        if near_check and self.backend == "numba" and controller.checks_near:
            self.near = ProximityCheck(rig.in_units(self.unit_m), controller.fields, body)

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
        seen: Any = None,
    ) -> tuple[Command, Callable[[], NavigatorState]]:
        """The command, and what returns the state: map, localiser and checks for the next command take their time
        after this one. Arguments, command and state are those of a call of the module; `seen`, of the state of one car
        that saw this frame before, stands for the subfields.
        """
        if state is not None and not isinstance(state, NavigatorState):
            raise InputError(f"state must be a NavigatorState or None, got {type(state).__name__}")
        # Whole frames stand for both of their strips: each step cuts its own.
        left = left if isinstance(left, Strips) else Strips(left, left)
        right = right if isinstance(right, Strips) else Strips(right, right)
        shape, tensors = frames_shape(left, right), self.backend == "torch"
        if not tensors and len(shape) > 1:
            return self.car_by_car((left, right), state, driven, start, shape)
        start = start if start is None or tensors else Pose(*map(float, start))
        commands = []
        # Frame by frame, because what is done at one frame is what was driven on the path to the next.
        for t in range(shape[-1]):
            moved = driven
            if driven is not None:
                speed, curvature = driven.speed[..., t], driven.curvature[..., t]
                moved = Command(speed, curvature) if tensors else Command(float(speed), float(curvature))
            command, complete = self.step(left, right, t, state, moved, start, seen)
            commands.append(command)
            if t + 1 < shape[-1]:
                state = complete()
        if tensors:
            speed, curvature = (torch.stack(part, -1) for part in zip(*commands, strict=True))
        else:
            speed, curvature = torch.from_numpy(np.array(commands, np.float32).T)
        return Command(speed, curvature), complete

    def step(
        self,
        left: Strips,
        right: Strips,
        t: int,
        state: NavigatorState | None,
        driven: Command | None,
        start: Pose | None,
        seen: Any,
    ) -> tuple[Command, Callable[[], NavigatorState]]:
        """Frame number t of each camera: see, range, reckon, decide; and what is done once that is commanded."""
        controller: Controller = self._modules["controller"]  # type: ignore[assignment]
        frames, rows, seen, sides, ranges, fields, filters = self.see(left, right, t, state, seen)
        # Where the car is by dead reckoning; the controller works in units of its body
        begins = state is None or state.fields is None
        before = self.begin(seen, ranges, start) if state is None else state
        last = before.command if driven is None else driven
        pose, control, located = self.reckoning.step(before.pose, *last), before.control, before.located
        place = pose
        if self.localiser is not None and controller.has_goals:
            # It steers by the localiser's odometry, which sees where wheels slip, and never jumps.
            located = self.locate(rows, pose, located)
            place, corrected = Pose(*located.odometry.tolist()), Pose(*located.pose.tolist())
            control = controller.on_pose(control, pose_in(place, self.unit_m), pose_in(corrected, self.unit_m))
        # The command
        unit, ranged, moved = self.unit_m, ranges, last
        if unit != 1:
            place = pose_in(place, unit)
            x, y, distance = ranges.x / unit, ranges.y / unit, ranges.left_range / unit
            ranged = ranges._replace(left_range=distance, x=x, y=y)
            moved = Command(last.speed / unit, last.curvature * unit)
        command, control = controller.step(seen, ranged, place, moved, control)
        if unit != 1:
            command = Command(command.speed * unit, command.curvature / unit)
        if self.near is not None and begins:
            command = Command(0.0, 0.0)  # what is near is not checked yet

        def complete() -> NavigatorState:
            after, at = control, located
            if self.near is not None:
                after = self.check_near(frames, rows, ranged, place, last, after, begins)
            if self.localiser is not None and not controller.has_goals:
                at = self.locate(rows, pose, at)
            now = (fields, filters, after, command, pose, sides, after.difference, ranges)
            kept = seen if isinstance(seen, np.ndarray) else None
            complete = NavigatorState(*now, before.map, before.observations, before.tracks, at, kept)
            return self.fill_map(complete) if self.grid_map or self.observations or self.tracker else complete

        return command, complete

    def see(self, left: Strips, right: Strips, t: int, state: NavigatorState | None, seen: Any) -> tuple[Any, ...]:
        """Frame number t: subfields and rows of both cameras, what the controller steers by, image speeds
        on both sides, ranges, and the states of the filters of subfields and rows.
        """
        controller: Controller = self._modules["controller"]  # type: ignore[assignment]
        ranging: StereoRanging = self._modules["ranging"]  # type: ignore[assignment]
        fields, filters = (None, None) if state is None else (state.fields, state.rows)
        if self.backend == "numba":
            frames = as_frames(left.field[t], right.field[t])
            rows = frames if left.row is left.field else as_frames(left.row[t], right.row[t])
            if seen is None:
                seen, sides, fields = controller.see(frames, fields)
            else:
                sides, fields = seen[:2].reshape(2, -1).max(1), seen
            ranges, filters = ranging.step(rows, filters)
            return frames, rows, seen, sides, ranges, fields, filters
        pairs = [(one.narrow(-4, t, 1), other.narrow(-4, t, 1)) for one, other in zip(left, right, strict=True)]
        seen, sides, fields = controller.see(pairs[0], fields)
        ranges, filters = ranging(*pairs[1], filters)
        return *pairs, seen, sides, Ranges(*(part[..., 0, :] for part in ranges)), fields, filters

    def begin(self, seen: Any, ranges: Ranges, start: Pose | None) -> NavigatorState:
        still = torch.zeros_like(ranges.x[..., 0]) if self.backend == "torch" else 0.0
        pose = Pose(still, still, still) if start is None else start
        control = self.controller.start(seen, pose_in(pose, self.unit_m))
        return NavigatorState(None, None, control, Command(still, still), pose, None, still, ranges, None, None, None)

    def check_near(
        self, frames: Frames, rows: Frames, ranges: Ranges, pose: Pose, last: Command, control: Any, begins: bool
    ) -> Any:
        """The controller's state after a check of what is near, if it stands, and after what it asks for.

        Ranges and pose are in units of the body; `last` was driven on the path to the pose.
        """
        assert self.near is not None
        near = self.near
        if abs(last.speed) <= STATIONARY and (begins or control.mode in (SUPPRESSED, STOPPED)):
            scan = near(frames, rows, Obstacles(ranges.x[ranges.valid], ranges.y[ranges.valid]))
            control = self.controller.on_near_obstacles(control, pose, scan)
        return self.controller.look_again(control, pose, lambda: near.obstacles(rows))

    def locate(self, rows: Frames, pose: Pose, located: LocaliserState | None) -> LocaliserState:
        assert self.localiser is not None
        grey = np.empty((2, 1, self.size[1]), np.float32)
        due = self.localiser.due(located)
        if due:
            grey_fields(at_rects(rows, (self.row, self.row), self.size), 1, grey)
        return self.localiser(grey[:, 0] if due else None, pose, located)

    def fill_map(self, state: NavigatorState) -> NavigatorState:
        """Fill the map, the observation list and the tracks, as far as there are any."""
        ranges, poses = state.ranges, state.place
        grid, seen, tracks = state.map, state.observations, state.tracks
        if self.backend == "numba":
            ranges, poses = Ranges(*map(torch.from_numpy, ranges)), Pose(*torch.tensor(poses).unbind())
        ranges, poses = Ranges(*(part.unsqueeze(-2) for part in ranges)), Pose(*(x.unsqueeze(-1) for x in poses))
        if self.grid_map is not None:
            grid = self.grid_map.update(ranges, poses, grid)
        if self.observations is not None:
            _, seen = self.observations(ranges, poses, seen)
        if self.tracker is not None:
            _, tracks = self.tracker(ranges, poses, tracks)
        return state._replace(map=grid, observations=seen, tracks=tracks)

    def car_by_car(
        self,
        eyes: tuple[Strips, Strips],
        state: NavigatorState | None,
        driven: Command | None,
        start: Pose | None,
        shape: tuple[int, ...],
    ) -> tuple[Command, Callable[[], NavigatorState]]:
        batch, dims = shape[:-1], len(shape) - 1
        made = [
            self.command_first(*(one_car(part, n, dims) for part in (*eyes, state, driven, start)))
            for n in range(math.prod(batch))
        ]
        commands, rests = zip(*made, strict=True)
        return all_cars(list(commands), batch), lambda: all_cars([rest() for rest in rests], batch)

    def on_goal(self, state: NavigatorState, goal: tuple[float, float]) -> NavigatorState:
        """The state of one car that is sent to another place, x and y in m."""
        x, y = goal
        control = self.controller.on_goal(state.control, (x / self.unit_m, y / self.unit_m))
        return state._replace(control=control)

    def mode(self, state: NavigatorState) -> Any:
        """What the controller is doing, `[...]`: one of its `modes`, `CRUISE`, `TURN`, ..."""
        if self.backend == "torch" or isinstance(state.pose.x, float):
            return self.controller.mode(state.control)
        cars = state.pose.x.shape
        modes = [self.controller.mode(one_car(state.control, n, len(cars))) for n in range(state.pose.x.size)]
        return all_cars(modes, cars)

    def warm_up(self, frame: Tensor | None = None) -> None:
        """Compile the steps, or load what was compiled before, before a car depends on them.

        The first time takes about a minute.

        Args:
            frame: one like those that will come, `[1, C, H, W]`; compiled steps differ with its dtype and its layout.
                By default a color image as OpenCV has it, uint8, the colors of a pixel beside each other.
        """
        if self.backend == "torch":
            return
        if frame is None:
            frame = torch.zeros(1, *self.size, 3, dtype=torch.uint8).permute(0, 3, 1, 2)
        _, state = self(frame, frame)
        self(frame, frame, state)
        both = as_frames(frame[0], frame[0])
        self.ranging.step(both, None)
        if self.near is not None:
            self.near(both, both)
        self.controller.warm_up()
        if self.localiser is not None:
            self.localiser.warm_up()


def frames_shape(left: Strips, right: Strips) -> tuple[int, ...]:
    """Leading dimensions `[..., T]` of the frames; raises `InputError` for strips of different frames, or none."""
    shape = getattr(left.field, "shape", ())
    for part in (*left, *right):
        if not isinstance(part, Tensor) or part.ndim < 4 or not part.shape[-4] or part.shape[:-3] != shape[:-3]:
            raise InputError(
                f"expected tensors [..., T, C, H, W] of the same frames with T >= 1, got {type(part).__name__} "
                f"{tuple(getattr(part, 'shape', ()))} beside {tuple(shape)}"
            )
    return tuple(shape[:-3])


def pose_in(pose: Pose, unit: float) -> Pose:
    return Pose(pose.x / unit, pose.y / unit, pose.heading)


def one_car(tree: Any, n: int, dims: int) -> Any:
    """The state of one of a batch whose `dims` leading dimensions count cars."""
    if isinstance(tree, Tensor):
        return tree.flatten(0, dims - 1)[n]
    if isinstance(tree, np.ndarray):
        part = tree.reshape(math.prod(tree.shape[:dims]), *tree.shape[dims:])[n]
        return part if part.ndim else part.item()
    return None if tree is None else made_like(tree, [one_car(part, n, dims) for part in tree])


def all_cars(trees: list[Any], batch: tuple[int, ...]) -> Any:
    """The opposite of `one_car`: the states of all cars as one, every part `[*batch, ...]`."""
    first = trees[0]
    if isinstance(first, Tensor):
        return torch.stack(trees).reshape(*batch, *first.shape)
    if first is None or isinstance(first, tuple):
        return first and made_like(first, [all_cars(list(part), batch) for part in zip(*trees, strict=True)])
    stacked = np.stack([np.asarray(tree) for tree in trees])
    return stacked.reshape(*batch, *stacked.shape[1:])


def made_like(tree: Any, parts: list[Any]) -> Any:
    return type(tree)(*parts) if hasattr(tree, "_fields") else type(tree)(parts)
