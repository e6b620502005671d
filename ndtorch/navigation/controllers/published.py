"""The published controller: saccades away from the side where the image moves faster."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_numbers, check_tensor
from ndtorch.errors import InputError
from ndtorch.kernels.avoidance import avoidance
from ndtorch.kernels.switch import kernels_wanted
from ndtorch.navigation.controllers.contract import (
    CRUISE,
    STOPPED,
    SUPPRESSED,
    TURN,
    Command,
    Controller,
    Trace,
    stack_commands,
)
from ndtorch.navigation.controllers.published_quick import QuickSaccades
from ndtorch.navigation.controllers.registry import register
from ndtorch.navigation.controllers.subfields import SubfieldMotion
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import Rect, StereoRig
from ndtorch.vision.temporal import low_pass_step, smoothing_factor, time_dim


@dataclass(frozen=True)
class AvoidanceParams:
    """The numbers of [A Methods]; thresholds are in the scaled units of [A fig. 3], raw output x 20.

    Args:
        turn_threshold: a turn starts where the magnitude of right - left, low-passed, exceeds this, T_turn.
        high_threshold: a tight turn starts where both sides exceed this, T_turn,H.
        low_threshold: the car stops where both sides are below this, T_turn,L.
        turn_radius, tight_radius: radii of the two kinds of turn, m.
        turn_time: duration of every turn, s.
        suppression_time: time without a new turn, s, counted from the end of a turn.
        from_start: count the suppression from the start of the turn instead; the car then reacts a turn's
            time earlier, which helps at walls that are met head-on.
        smoothing: time constant of the low-pass on the difference, s.
        speed: m/s while not stopped.
        start_time: time of suppression at the start, s. Not in [A]: a camera that has not moved yet
            sees nothing move, and the rule for low outputs would stop the car before it starts.
    """

    turn_threshold: float = 0.15
    high_threshold: float = 2.0
    low_threshold: float = 0.08
    turn_radius: float = 1.0
    tight_radius: float = 0.5
    turn_time: float = 1.0
    suppression_time: float = 2.0
    from_start: bool = False
    smoothing: float = 1 / 30
    speed: float = 0.5
    start_time: float = 0.5

    def __post_init__(self) -> None:
        check_numbers(self)
        for name, value in vars(self).items():
            if not value >= 0:
                raise InputError(f"{name} must be a number >= 0, got {value}")
        if self.turn_radius == 0 or self.tight_radius == 0:
            raise InputError("turn_radius and tight_radius must be > 0")


class AvoidanceState(NamedTuple):
    """State of `SaccadeAvoidance`, every part `[...]`.

    Attributes:
        difference: right minus left, low-passed: positive where the car should rather turn left.
        age: time steps since the last turn began; minus infinity once the car has stopped.
        curvature: what is being driven, 1/m, to the left positive.
    """

    difference: Tensor
    age: Tensor
    curvature: Tensor


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
    if sides.ndim == 1 and kernels_wanted(sides, *state):
        return avoidance_of_one(sides, state, constants)
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


def avoidance_of_one(
    sides: Tensor, state: AvoidanceState, constants: AvoidanceConstants
) -> tuple[Command, AvoidanceState]:
    """`avoidance_step` of one car, in plain numbers."""
    ours, theirs = sides.tolist()
    now = (float(state.difference), float(state.age), float(state.curvature))
    speed, bend, after = avoidance(ours, theirs, now, plain(constants))
    found = sides.new_tensor((speed, bend, *after)).unbind(0)
    return Command(found[0], found[1]), AvoidanceState(*found[2:])


def plain(constants: AvoidanceConstants) -> tuple[float, ...]:
    """The constants as the kernel takes them, rounded as the tensors are."""
    return (constants.smoothing, *(part.item() for part in constants[1:]))


class SaccadeAvoidance(nn.Module):
    """The state machine of the published controller: two speed estimates in, a command out. [A §2.2, Methods]

    As published it drives for minutes along walls met obliquely; it cannot avoid a wall met head-on from less
    than 1.4-2.7 m (with `from_start` 1.0-2.0 m).

    Shapes:
        sides `[..., T, 2]`, scaled speed estimates of the left and the right side -> `Command` of `[..., T]`.
        With `state=None` the difference is settled on the first sample and the car starts suppressed for
        `start_time`.

    Raises:
        InputError: dt not positive, or sides of another shape or type, or not finite.
    """

    def __init__(self, dt: float, params: AvoidanceParams | None = None) -> None:
        super().__init__()
        self.params, self.dt = params or AvoidanceParams(), dt
        p = self.params
        share = smoothing_factor(p.smoothing, dt)
        turn = max(1, round(p.turn_time / dt))
        suppressed = max(0, round((p.suppression_time - (p.turn_time if p.from_start else 0.0)) / dt))
        self.turn_steps, self.watching = turn, turn + suppressed
        values = [p.turn_threshold, p.high_threshold, p.low_threshold, 1 / p.turn_radius, 1 / p.tight_radius]
        values += [turn, self.watching, p.speed, 1.0, 0.0, -math.inf]
        self.constants = AvoidanceConstants(share, *map(torch.tensor, map(float, values)))
        self.numbers = plain(self.constants)

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
        return stack_commands(commands), state

    def start(self, sides: Tensor) -> AvoidanceState:
        """The state before the first sample `sides` `[..., 2]`."""
        difference = sides[..., 1] - sides[..., 0]
        # The first step adds one. Where this is less than a turn's time nothing turns: the curvature is zero.
        age = torch.full_like(difference, self.watching - 1 - round(self.params.start_time / self.dt))
        return AvoidanceState(difference, age, torch.zeros_like(difference))

    def mode(self, state: AvoidanceState) -> Tensor:
        """What the car is doing, `[...]` integers: `CRUISE`, `TURN`, `SUPPRESSED` or `STOPPED`."""
        mode = torch.where(state.age < self.watching, SUPPRESSED, CRUISE)
        mode = torch.where(state.curvature != 0, TURN, mode)
        return torch.where(state.age == -math.inf, STOPPED, mode)


@register
class PublishedControl(Controller):
    """The published controller: the largest motion beside the path on either side, and saccades away from it.

    Ranges and poses do not matter to it. What is seen is `[..., T, 2]`, see `SubfieldMotion`.

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
        rect = self.look.fields[0]
        shape = (2, rect.bottom - rect.top, rect.right - rect.left)
        self.quick = QuickSaccades(shape, self.look.nd_min.a, self.rule.numbers, AvoidanceState)

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

    def difference(self, state: AvoidanceState) -> Tensor:
        """Right minus left, low-passed."""
        return state.difference
