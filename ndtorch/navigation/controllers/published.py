"""The published controller: saccades away from the side where the image moves faster."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ndtorch.arguments import check_kind, check_numbers, check_tensor
from ndtorch.errors import InputError
from ndtorch.navigation.controllers._kernels import (
    AvoidanceState,
    SaccadeNumbers,
    avoidance,
    saccade_step,
    subfield_maxima,
)
from ndtorch.navigation.controllers.contract import CRUISE, STOPPED, SUPPRESSED, TURN, Command, Controller, Trace
from ndtorch.navigation.controllers.registry import register
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.stereo._kernels import Frames
from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch.navigation.stereo.strips import (
    array_frames,
    at_rects,
    check_eyes,
    check_peak,
    check_unit_range,
    checked,
    grey_pair,
)
from ndtorch.utils.jit import packed
from ndtorch.vision.nondirectional import SPEED_SCALE, NDMin, spatial_maximum
from ndtorch.vision.temporal import FilterState, low_pass_step, smoothing_factor, time_dim


@dataclass(frozen=True)
class AvoidanceParams:
    """Parameters of the published controller [A Methods]; thresholds are in the scaled units of [A fig. 3], raw
    output x 20.

    Args:
        turn_threshold: A turn starts where the magnitude of right - left, low-passed, exceeds this, T_turn.
        high_threshold: A tight turn starts where both sides exceed this, T_turn,H.
        low_threshold: The car stops where both sides are below this, T_turn,L.
        turn_radius_m: A turn has this radius.
        tight_radius_m: A tight turn has this radius.
        turn_s: Every turn lasts this long.
        suppression_s: No turn starts for this time after the end of a turn.
        suppress_from_start: The suppression counts from the start of the turn instead. The car then reacts a turn's
            time earlier, which helps at walls that are met head-on.
        smoothing_s: The low-pass on the difference has this time constant.
        speed_m_per_s: The car drives at this speed while it is not stopped.
        start_suppression_s: No turn starts and the car does not stop for this time after the start. It is not in [A]: a
            camera that has not moved yet sees nothing move, and the rule for low outputs would stop the car.

    Raises:
        InputError: A number is out of range.
    """

    turn_threshold: float = 0.15
    high_threshold: float = 2.0
    low_threshold: float = 0.08
    turn_radius_m: float = 1.0
    tight_radius_m: float = 0.5
    turn_s: float = 1.0
    suppression_s: float = 2.0
    suppress_from_start: bool = False
    smoothing_s: float = 1 / 30
    speed_m_per_s: float = 0.5
    start_suppression_s: float = 0.5

    def __post_init__(self) -> None:
        check_numbers(self, positive=("turn_radius_m", "tight_radius_m"))


class AvoidanceConstants(NamedTuple):
    """`AvoidanceParams` for one time step as scalar tensors.

    Torch compares two tensors faster than a tensor and a number, and scalars on the CPU combine with tensors
    of every device and floating type. Radii are curvatures; times are whole steps, so that no rounding of
    sums decides when one ends.
    """

    smoothing: float
    turn_threshold: Tensor
    high_threshold: Tensor
    low_threshold: Tensor
    normal: Tensor
    tight: Tensor
    turn_steps: Tensor
    watching: Tensor
    speed: Tensor
    one: Tensor
    zero: Tensor
    stopped: Tensor


def avoidance_step(
    sides: Tensor, state: AvoidanceState, constants: AvoidanceConstants
) -> tuple[Command, AvoidanceState]:
    """One time step of the state machine of [A fig. 5].

    A turn lasts its time, then comes the suppression; only cruising watches. There both sides below the low
    threshold stop the car for good (what does not move sees nothing move), both above the high one start a
    tight turn, else the smoothed difference can start a normal one. Turns lead away from the larger side.

    Args:
        sides: speed estimates `[..., 2]` of the left and the right side, scaled.
        state, constants: where the machine is, and its numbers.
    """
    c = constants
    left, right = sides.unbind(-1)
    now = right - left
    difference = low_pass_step(now, state.difference, c.smoothing)
    age = state.age + c.one
    cruising = age >= c.watching
    high = torch.minimum(left, right) > c.high_threshold
    stop = cruising & (torch.maximum(left, right) < c.low_threshold)
    turn = (cruising & (high | (difference.abs() > c.turn_threshold))) > stop

    away = torch.where(high, torch.copysign(c.tight, now), torch.copysign(c.normal, difference))
    kept = torch.where(age < c.turn_steps, state.curvature, c.zero)
    curvature = torch.where(turn, away, kept)
    age = torch.where(turn, c.zero, torch.where(stop, c.stopped, age))
    speed = torch.where(age > c.stopped, c.speed, c.zero).to(curvature.dtype)
    return Command(speed, curvature), AvoidanceState(difference, age, curvature)


class SubfieldMotion(nn.Module):
    """Speed of the image beside the path: the largest |ND-min| of a subfield of each camera. [A fig. 5]

    Shapes:
        left, right: frames `[..., T, C, H, W]`, or cut to the subfields, uint8 or float in 0..1, C = 1 or 3
            -> `[..., T, 2]`: left and right estimates in the units of the thresholds of [A], raw output x 20.
        State: the subfields, `[..., 2, h, w]`; `None` settles on the first frame.

    Args:
        rig: the camera pair.
        dt: time step, s.
        fields: the subfields, of one size; `rig.subfields()` by default.
        tau_high: time constant of the high-pass, s.

    Raises:
        InputError: frames that cannot be used (see `grey_pair`), or NaN, infinity or values far beyond 1 in
            them; subfields of two sizes or outside the frame.
    """

    def __init__(
        self,
        rig: StereoRig,
        dt: float,
        fields: tuple[Rect, Rect] | None = None,
        tau_high: float = 0.005,
    ) -> None:
        super().__init__()
        self.fields = fields or rig.subfields()
        self.size = (rig.height, rig.width)
        self.nd_min = NDMin(tau_high, dt)
        sizes = {(r.bottom - r.top, r.right - r.left) for r in self.fields}
        inside = all(0 <= r.top < r.bottom <= rig.height and 0 <= r.left < r.right <= rig.width for r in self.fields)
        if len(sizes) != 1 or not inside:
            raise InputError(f"subfields must be of one size and inside {self.size}, got {self.fields}")

    def forward(self, left: Tensor, right: Tensor, state: FilterState | None = None) -> tuple[Tensor, FilterState]:
        check_eyes(left, right)
        pair = grey_pair(left, right, *self.fields, self.size)
        motion, state = self.nd_min.scan(pair, state, pair.ndim - 4)
        sides = spatial_maximum(motion)
        check_unit_range(sides, left)
        return sides * SPEED_SCALE, state


class SaccadeAvoidance(nn.Module):
    """The state machine of the published controller: two speed estimates in, a command out. [A §2.2, Methods]

    As published it drives for minutes along walls met obliquely; it cannot avoid a wall met head-on from less
    than 1.4-2.7 m (with `suppress_from_start` 1.0-2.0 m).

    Shapes:
        sides `[..., T, 2]`, scaled speed estimates of the left and the right side -> `Command` of `[..., T]`.
        With `state=None` the difference is settled on the first sample and the car starts suppressed for
        `start_suppression_s`.

    Raises:
        InputError: dt not positive, or sides of another shape or type, or not finite.
    """

    def __init__(self, dt: float, params: AvoidanceParams | None = None) -> None:
        super().__init__()
        self.params, self.dt = params or AvoidanceParams(), dt
        p = self.params
        share = smoothing_factor(p.smoothing_s, dt)
        turn = max(1, round(p.turn_s / dt))
        suppressed = max(0, round((p.suppression_s - (p.turn_s if p.suppress_from_start else 0.0)) / dt))
        self.turn_steps, self.watching = turn, turn + suppressed
        values = [p.turn_threshold, p.high_threshold, p.low_threshold, 1 / p.turn_radius_m, 1 / p.tight_radius_m]
        values += [turn, self.watching, p.speed_m_per_s, 1.0, 0.0, -math.inf]
        self.constants = AvoidanceConstants(share, *map(torch.tensor, map(float, values)))

    def forward(self, sides: Tensor, state: AvoidanceState | None = None) -> tuple[Command, AvoidanceState]:
        dim = time_dim(sides, 1, "sides")
        check_tensor("sides", sides)
        if sides.shape[-1] != 2:
            raise InputError(f"sides must be speed estimates [..., T, 2], got {tuple(sides.shape)}")
        if state is None:
            state = self.start(sides.select(dim, 0))
        commands = []
        for sample in sides.unbind(dim):
            command, state = avoidance_step(sample, state, self.constants)
            commands.append(command)
        speed, curvature = (torch.stack(parts, -1) for parts in zip(*commands, strict=True))
        return Command(speed, curvature), state

    def start(self, sides: Tensor) -> AvoidanceState:
        """The state before the first sample `sides` `[..., 2]`."""
        difference = sides[..., 1] - sides[..., 0]
        # The first step adds one. Where this is less than a turn's time nothing turns: the curvature is zero.
        age = torch.full_like(difference, self.watching - 1 - round(self.params.start_suppression_s / self.dt))
        return AvoidanceState(difference, age, torch.zeros_like(difference))

    def mode(self, state: AvoidanceState) -> Tensor:
        """What the car is doing, `[...]` integers: `CRUISE`, `TURN`, `SUPPRESSED` or `STOPPED`."""
        mode = torch.where(state.age < self.watching, SUPPRESSED, CRUISE)
        mode = torch.where(state.curvature != 0, TURN, mode)
        return torch.where(state.age == -math.inf, STOPPED, mode)


@register
class PublishedControl(Controller):
    """The published controller: the largest motion beside the path on either side, and saccades away from it.

    Ranges and poses do not matter to it. What is seen is `[..., 2]`, see `SubfieldMotion`. This one is differentiable
    and steps any batch; `SaccadeController` is the same for one car, compiled.

    Args:
        rig, dt: as `Controller`.
        params: of `SaccadeAvoidance`.
        fields: the subfields; `rig.subfields()` by default.
    """

    name, Params, modes = "published", AvoidanceParams, (CRUISE, TURN, SUPPRESSED, STOPPED)

    def __init__(
        self,
        rig: StereoRig,
        dt: float,
        params: AvoidanceParams | None = None,
        fields: tuple[Rect, Rect] | None = None,
    ) -> None:
        super().__init__(rig, dt, params)
        self.look, self.rule = SubfieldMotion(rig, dt, fields), SaccadeAvoidance(dt, self.params)

    @property
    def trace(self) -> Trace:
        """The difference of both speeds, and the thresholds of [A fig. 7]."""
        p = self.params
        return Trace("right - left, low-passed", turn=p.turn_threshold, stop=p.low_threshold)

    def sides(self, seen: Tensor) -> Tensor:
        """What is seen are the speeds."""
        return seen

    def start(self, seen: Tensor, pose: Pose) -> AvoidanceState:
        """Settled on the first sample, suppressed."""
        return self.rule.start(seen)

    def step(
        self, seen: Tensor, ranges: Ranges, pose: Pose, driven: Command, state: AvoidanceState
    ) -> tuple[Command, AvoidanceState]:
        """One time step of the state machine."""
        return avoidance_step(seen, state, self.rule.constants)

    def mode(self, state: AvoidanceState) -> Tensor:
        """As `SaccadeAvoidance.mode`."""
        return self.rule.mode(state)

    def difference(self, state: AvoidanceState) -> Any:
        """Right minus left, low-passed."""
        return state.difference


SETTLED = (0.0, 0.0, 0.0)
"""Stands for the state machine before the first frame."""


class SaccadeState(NamedTuple):
    """State of `SaccadeController` called by itself.

    Attributes:
        low: of the high-pass of both subfields, `[2, h, w]` float32.
        machine: of the state machine.
    """

    low: Any
    machine: AvoidanceState


@register
class SaccadeController(Controller):
    """`PublishedControl` for one car, compiled: [A fig. 5].

    It can be called by itself, in loops that want nothing else, tens of thousands of steps a second.

    Shapes:
        left, right: uint8 arrays `[H, W, 3]`, `[H, W, 1]` or `[3, H, W]` of the two cameras, both of one kind -> speed
            in m/s and curvature in 1/m. `state=None` begins with this frame.

    Args:
        rig, dt, params, fields: as `PublishedControl`.

    Raises:
        InputError: frames of another size, type or number of colors.
    """

    name, Params, modes = "published", AvoidanceParams, (CRUISE, TURN, SUPPRESSED, STOPPED)
    backend = "numba"

    def __init__(
        self,
        rig: StereoRig,
        dt: float,
        params: AvoidanceParams | None = None,
        fields: tuple[Rect, Rect] | None = None,
    ) -> None:
        super().__init__(rig, dt, params)
        look, rule = SubfieldMotion(rig, dt, fields), SaccadeAvoidance(dt, self.params)
        self.rects, self.size, self.a = look.fields, look.size, look.nd_min.a
        begun = float(rule.watching - 1 - round(self.params.start_suppression_s / dt))
        rect, other = self.rects
        corners = rect.top, rect.left, other.top, other.left
        constants = [float(part) for part in rule.constants[:9]]
        self.numbers = SaccadeNumbers._make((*constants, begun, self.a, *corners))
        self.packed = packed(self.numbers)
        self.shape = (2, rect.bottom - rect.top, rect.right - rect.left)

    @property
    def fields(self) -> tuple[Rect, Rect]:
        """As `Controller.fields`."""
        return self.rects

    def forward(
        self, left: np.ndarray[Any, Any], right: np.ndarray[Any, Any], state: SaccadeState | None = None
    ) -> tuple[Command, SaccadeState]:
        check_kind("state", state, SaccadeState)
        frames, low = array_frames(left, right, self.size), np.empty(self.shape, np.float32)
        before, machine = (low, SETTLED) if state is None else (checked(state.low, self.shape), tuple(state.machine))
        command, after = saccade_step(*frames[:4], before, machine, state is None, low, self.packed)
        if not math.isfinite(sum((*machine, *after))):  # whole numbers were seen: NaN is of the state, and would stay
            raise InputError(f"state must be finite, got {state}")
        return Command(*command), SaccadeState(low, AvoidanceState(*after))

    @property
    def trace(self) -> Trace:
        """As of `PublishedControl`."""
        return Trace("right - left, low-passed", turn=self.params.turn_threshold, stop=self.params.low_threshold)

    def see(self, frames: Frames, state: Any = None) -> tuple[Any, Any]:
        """Image speeds `[2]`, and the state of the filters."""
        cells, low = np.empty((2, 1, 1), np.float32), np.empty(self.shape, np.float32)
        before = low if state is None else checked(state, self.shape)
        check_peak(subfield_maxima(at_rects(frames, self.rects, self.size), state is None, before, self.a, low, cells))
        return cells.ravel() * SPEED_SCALE, low

    def sides(self, seen: Any) -> Any:
        """What is seen are the speeds."""
        return seen

    def begin(self, left: float, right: float) -> AvoidanceState:
        """Settled on the first sample, suppressed."""
        return AvoidanceState(right - left, self.numbers.age, 0.0)

    def start(self, seen: Any, pose: Pose) -> AvoidanceState:
        """As `SaccadeAvoidance.start`."""
        return self.begin(*seen.tolist())

    def step(
        self, seen: Any, ranges: Ranges, pose: Pose, driven: Command, state: AvoidanceState
    ) -> tuple[Command, AvoidanceState]:
        """One time step of the state machine."""
        left, right = seen.tolist()
        return avoidance.function(left, right, state, self.numbers)

    def mode(self, state: AvoidanceState) -> int:
        """As `SaccadeAvoidance.mode`."""
        if state.age == -math.inf:
            return STOPPED
        if state.curvature:
            return TURN
        return SUPPRESSED if state.age < self.numbers.watching else CRUISE

    def difference(self, state: AvoidanceState) -> float:
        """Right minus left, low-passed."""
        difference: float = state.difference
        return difference
