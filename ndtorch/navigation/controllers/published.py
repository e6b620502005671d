"""The published controller: saccades away from the side where the image moves faster."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.controllers.contract import CRUISE, STOPPED, SUPPRESSED, TURN, Command, Controller, register
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.stereo._kernels import Array, Frames, cell_maxima, grey_fields, packed
from ndtorch.navigation.stereo.ranging import TAU_HIGH, Ranges
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.navigation.stereo.strips import at_rects, check_peak, checked, grey_pair
from ndtorch.utils.jit import jit
from ndtorch.vision.nondirectional import SPEED_SCALE, NDMin, spatial_maximum
from ndtorch.vision.temporal import FilterState, check_series, low_pass_step, smoothing_factor


@dataclass(frozen=True)
class AvoidanceParams:
    """Parameters of the published controller [A Methods]; thresholds are scaled as in [A fig. 3], raw output x 20.

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


class AvoidanceState(NamedTuple):
    """State of `SaccadeAvoidance`, every part `[...]`; numbers in the compiled step."""

    difference: Any  # right minus left, low-passed: positive where the car should rather turn left
    age: Any  # time steps since the last turn began; minus infinity once the car has stopped
    curvature: Any  # what is being driven, 1/m, to the left positive


class SubfieldMotion(nn.Module):
    """Speed of the image beside the path: the largest |ND-min| of a subfield of each camera. [A fig. 5]

    Shapes:
        left, right: frames `[..., T, C, H, W]`, or cut to the subfields, uint8 or float in 0..1, C = 1 or 3
            -> `[..., T, 2]`: left and right estimates in the units of the thresholds of [A], raw output x 20.
        State: the subfields, `[..., 2, h, w]`; `None` settles on the first frame.

    Raises:
        InputError: frames that cannot be used (see `grey_pair`), or NaN, infinity or values far beyond 1 in
            them; subfields outside the frame.
    """

    def __init__(self, rig: StereoRig, dt: float) -> None:
        super().__init__()
        self.fields, self.size, self.nd_min = rig.subfields(), (rig.height, rig.width), NDMin(TAU_HIGH, dt)

    def forward(self, left: Tensor, right: Tensor, state: FilterState | None = None) -> tuple[Tensor, FilterState]:
        pair = grey_pair(left, right, *self.fields, self.size)
        motion, state = self.nd_min.scan(pair, state)
        sides = spatial_maximum(motion)
        check_peak(sides, left)
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
        self.params = p = params or AvoidanceParams()
        # Times are whole steps, so that no rounding of sums decides when one ends.
        self.share, self.turn = smoothing_factor(p.smoothing_s, dt), float(max(1, round(p.turn_s / dt)))
        suppression = p.suppression_s - (p.turn_s if p.suppress_from_start else 0.0)
        self.watching = self.turn + max(0, round(suppression / dt))
        # The first step adds one. Where the age is less than a turn's time nothing turns: the curvature is zero.
        self.age = self.watching - 1 - round(p.start_suppression_s / dt)

    def forward(self, sides: Tensor, state: AvoidanceState | None = None) -> tuple[Command, AvoidanceState]:
        check_series(sides, 1, name="sides")
        if sides.shape[-1] != 2:
            raise InputError(f"sides must be speed estimates [..., T, 2], got {tuple(sides.shape)}")
        if state is None:
            state = self.start(sides[..., 0, :])
        commands = []
        for sample in sides.unbind(-2):
            command, state = self.step(sample, state)
            commands.append(command)
        speed, curvature = (torch.stack(parts, -1) for parts in zip(*commands, strict=True))
        return Command(speed, curvature), state

    def step(self, sides: Tensor, state: AvoidanceState) -> tuple[Command, AvoidanceState]:
        """One time step of the state machine of [A fig. 5], of scaled speed estimates `[..., 2]`.

        A turn lasts its time, then comes the suppression; only cruising watches. There both sides below the low
        threshold stop the car for good (what does not move sees nothing move), both above the high one start a
        tight turn, else the smoothed difference can start a normal one. Turns lead away from the larger side.
        """
        p, (left, right) = self.params, sides.unbind(-1)
        now = right - left
        difference = low_pass_step(now, state.difference, self.share)
        age = state.age + 1.0
        cruising = age >= self.watching
        high = torch.minimum(left, right) > p.high_threshold
        stop = cruising & (torch.maximum(left, right) < p.low_threshold)
        turn = cruising & ~stop & (high | (difference.abs() > p.turn_threshold))
        away = torch.where(torch.where(high, now, difference) < 0, -1.0, 1.0)
        away = away / torch.where(high, p.tight_radius_m, p.turn_radius_m)
        curvature = torch.where(turn, away, torch.where(age < self.turn, state.curvature, 0.0))
        age = torch.where(turn, 0.0, torch.where(stop, -math.inf, age))
        speed = torch.where(age > -math.inf, p.speed_m_per_s, torch.zeros_like(curvature))
        return Command(speed, curvature), AvoidanceState(difference, age, curvature)

    def start(self, sides: Tensor) -> AvoidanceState:
        """The state before the first sample `sides` `[..., 2]`."""
        difference = sides[..., 1] - sides[..., 0]
        return AvoidanceState(difference, torch.full_like(difference, self.age), torch.zeros_like(difference))

    def mode(self, state: AvoidanceState) -> Tensor:
        mode = torch.where(state.age < self.watching, SUPPRESSED, CRUISE)
        mode = torch.where(state.curvature != 0, TURN, mode)
        return torch.where(state.age == -math.inf, STOPPED, mode)


@jit(exact=True)
def avoidance(
    left: float, right: float, state: tuple[float, float, float], numbers: Array
) -> tuple[tuple[float, float], tuple[float, float, float]]:
    """`SaccadeAvoidance.step` of one car in plain numbers and tuples, which Numba takes at once."""
    p, now, (before, age, curvature) = numbers[0], right - left, state
    difference, age = before + p.share * (now - before), age + 1.0
    cruising, high = age >= p.watching, min(left, right) > p.high_threshold
    stop = cruising and max(left, right) < p.low_threshold
    if cruising and not stop and (high or abs(difference) > p.turn_threshold):
        away, radius = (now, p.tight_radius_m) if high else (difference, p.turn_radius_m)
        curvature, age = math.copysign(1 / radius, away), 0.0
    elif age >= p.turn:
        curvature = 0.0
    if stop:
        age = -math.inf
    return (p.speed_m_per_s if age > -math.inf else 0.0, curvature), (difference, age, curvature)


@jit(exact=True)
def subfield_maxima(frames: Frames, settle: bool, low: Array, numbers: Array, new_low: Array, cells: Array) -> float:
    """`SubfieldMotion` of one frame: the largest |ND-min| of each rectangle into `cells` `[2, 1, 1]`."""
    grey = np.empty(new_low.shape, np.float32)
    finite = grey_fields(frames, 1, grey)
    peak = cell_maxima(grey, settle, low, numbers[0].a, new_low, cells)
    cells *= np.float32(SPEED_SCALE)
    return peak if finite else np.nan


@register
class PublishedControl(Controller):
    """The published controller: the largest motion beside the path on either side, and saccades away from it.

    Ranges and poses do not matter to it. What is seen is `[..., 2]`, see `SubfieldMotion`. This one is differentiable
    and steps any batch; `CompiledPublished` is the same for one car.
    """

    name, Params, modes = "published", AvoidanceParams, (CRUISE, TURN, SUPPRESSED, STOPPED)

    def __init__(self, rig: StereoRig, dt: float, params: AvoidanceParams | None = None) -> None:
        super().__init__(rig, dt, params)
        self.look, self.rule = SubfieldMotion(rig, dt), SaccadeAvoidance(dt, self.params)
        self.fields = self.look.fields

    def see(self, frames: Any, state: Any = None) -> tuple[Any, Any, Any]:
        motion, state = self.look(*frames, state)
        sides = motion.select(frames[0].ndim - 4, 0)
        return sides, sides, state

    def start(self, seen: Any, pose: Pose) -> AvoidanceState:
        return self.rule.start(seen)

    def step(
        self, seen: Any, ranges: Ranges, pose: Pose, driven: Command, state: AvoidanceState
    ) -> tuple[Command, AvoidanceState]:
        return self.rule.step(seen, state)

    def mode(self, state: AvoidanceState) -> Any:
        return self.rule.mode(state)


@register
class CompiledPublished(PublishedControl):
    """`PublishedControl` for one car, compiled."""

    backend = "numba"

    def __init__(self, rig: StereoRig, dt: float, params: AvoidanceParams | None = None) -> None:
        super().__init__(rig, dt, params)
        rule = self.rule
        derived = {"share": rule.share, "turn": rule.turn, "watching": rule.watching, "age": rule.age}
        self.numbers, self.size = packed(self.params, a=float(self.look.nd_min.a), **derived), self.look.size

    def see(self, frames: Frames, state: Any = None) -> tuple[Any, Any, Any]:
        cells, low = np.empty((2, 1, 1), np.float32), np.empty((2, *self.fields[0].size), np.float32)
        before, frames = low if state is None else checked(state, low.shape), at_rects(frames, self.fields, self.size)
        check_peak(subfield_maxima(frames, state is None, before, self.numbers, low, cells))
        sides = cells.ravel()
        return sides, sides, low

    def start(self, seen: Any, pose: Pose) -> AvoidanceState:
        left, right = seen.tolist()
        return AvoidanceState(right - left, self.rule.age, 0.0)

    def step(
        self, seen: Any, ranges: Ranges, pose: Pose, driven: Command, state: AvoidanceState
    ) -> tuple[Command, AvoidanceState]:
        command, after = avoidance(*seen.tolist(), tuple(state), self.numbers)
        return Command(*command), AvoidanceState(*after)

    def mode(self, state: AvoidanceState) -> int:
        if state.age == -math.inf:
            return STOPPED
        if state.curvature:
            return TURN
        return SUPPRESSED if state.age < self.rule.watching else CRUISE
