"""What a controller is: what it reads of each eye, what it makes of that, and how it steers by it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import torch
from torch import Tensor, nn

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.controllers.quick import QuickControl
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity.stereo_match import Obstacles
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import Rect, StereoRig
from ndtorch.vision.temporal import FilterState

CRUISE, TURN, SUPPRESSED, STOPPED, REVERSE, ARRIVED = 0, 1, 2, 3, 4, 5
"""What a controller can be doing, the numbers of `Controller.mode`."""


class Glance(NamedTuple):
    """What one car wants to be told beside its own ranges: what stands `ahead`, and what is too `near` to be ranged."""

    ahead: bool = False
    near: bool = False


class Command(NamedTuple):
    """What the car is to do: `speed` in m/s and `curvature` in 1/m, positive to the left."""

    speed: Tensor
    curvature: Tensor


@dataclass(frozen=True)
class Task:
    """What a controller is asked to do.

    Args:
        to: a place to go to, x, y in m; None for none.
        explore: drive wherever it was not yet.
        back: then go back to where the drive began.
        cruise: speed where nothing is in the way, m/s.
    """

    to: tuple[float, float] | None = None
    explore: bool = False
    back: bool = False
    cruise: float = 0.5

    def __post_init__(self) -> None:
        check_numbers(self)
        if self.cruise < 0:
            raise InputError(f"cruise must be a speed >= 0, got {self.cruise}")

    @property
    def has_goal(self) -> bool:
        """Whether it says where to go."""
        return self.to is not None or self.explore or self.back


@dataclass(frozen=True)
class Trace:
    """What a figure or a viewer draws of a controller, beside the speeds on both sides and its modes.

    Args:
        difference: what `Controller.difference` is, in words; positive where the car should rather turn left.
        unit: of it; empty where it has none.
        turn: the car turns where the size of the difference exceeds this; 0 where only its sign counts.
        stop: the car stops where the speeds on both sides are below this; None where it never does so.
    """

    difference: str
    unit: str = ""
    turn: float = 0.0
    stop: float | None = None

    def lines(self) -> dict[str, float]:
        """The levels that mean something, by name."""
        turns = {"turn left": self.turn, "turn right": -self.turn} if self.turn > 0 else {}
        return turns | ({} if self.stop is None else {"stop": self.stop})


class Controller(nn.Module, ABC):
    """What steers a `Navigator`. Another one is one new file in this folder, with a class like this in it:

    ```python
    @register
    class Straight(Controller):
        name, Params, modes = "straight", StraightParams, (CRUISE,)
    ```

    As everywhere, the module holds what is fixed, and its state, a NamedTuple of tensors, is passed in and out.

    Its eyes are called as `seen, state = look(left, right, state)` with frames `[..., T, C, H, W]`, whole or cut to
    the fields.

    Shapes:
        seen `[..., T, ...]` of `look`, ranges `[..., T, n]`, poses and driven commands `[..., T]` -> `Command` of
        `[..., T]`. `state=None` starts at the first of each.

    Attributes:
        name: by which it is chosen.
        Params: dataclass of its numbers, all with defaults.
        modes: which of `CRUISE`, `TURN`, ... it can be in.
        has_goals: whether it can be told where to go.
        looks_near: whether it wants to be told what is right before it while it stands.
        params: its numbers.
        quick: what the kernel of a whole step has to know of it; None where there is no such kernel.
        look: module from what both cameras see of `look.fields` to what the controller steers by.

    Args:
        rig: the camera pair.
        dt: time step, s.
        params: its numbers; the defaults where none are given.

    Raises:
        InputError: parameters of another controller.
    """

    name: ClassVar[str]
    Params: ClassVar[type[Any]]
    modes: ClassVar[tuple[int, ...]]
    has_goals: ClassVar[bool] = False
    looks_near: ClassVar[bool] = False
    params: Any
    quick: QuickControl | None = None
    look: nn.Module

    def __init__(self, rig: StereoRig, dt: float, params: Any = None) -> None:
        super().__init__()
        self.params = self.Params() if params is None else params
        if not isinstance(self.params, self.Params):
            raise InputError(
                f"params must be {self.Params.__name__} for the {self.name} controller, got {type(params).__name__}"
            )

    @classmethod
    def params_for(cls, task: Task) -> Any:
        """The numbers with which the controller does what it is asked to.

        Raises:
            InputError: something that it cannot do.
        """
        if task.has_goal and not cls.has_goals:
            raise InputError(f"the {cls.name} controller has no goals: to, explore and back belong to controller goal")
        params = cls.Params()
        if task.cruise == Task.cruise:
            return params
        if not hasattr(params, "speed"):
            raise InputError(f"the {cls.name} controller has no cruise speed to choose")
        return replace(params, speed=task.cruise)

    @property
    def fields(self) -> tuple[Rect, Rect]:
        """The rectangles that it looks at, of the left and the right image."""
        fields: tuple[Rect, Rect] = self.look.fields  # type: ignore[assignment]
        return fields

    @property
    @abstractmethod
    def trace(self) -> Trace:
        """What to draw of it."""

    @abstractmethod
    def sides(self, seen: Tensor) -> Tensor:
        """Speed of the image on the left and the right, `[..., 2]`, of what was seen `[..., ...]`; to be drawn."""

    @abstractmethod
    def start(self, seen: Tensor, pose: Pose) -> Any:
        """The state before the first frame, in which `seen` is seen from `pose` `[...]`."""

    @abstractmethod
    def step(self, seen: Tensor, ranges: Ranges, pose: Pose, driven: Command, state: Any) -> tuple[Command, Any]:
        """One frame.

        Args:
            seen: what `look` gave for it.
            ranges: `[..., n]`.
            pose, driven: where the car is, and what it drove to get there, `[...]`.
            state: of the controller before.
        """

    @abstractmethod
    def mode(self, state: Any) -> Tensor:
        """What the car is doing, `[...]`: one of `modes`."""

    @abstractmethod
    def difference(self, state: Any) -> Tensor:
        """What it weighs, `[...]`: positive where the car should rather turn left. `trace` says what it is."""

    def woken(self, state: Any) -> Any:
        """The state with which a car that stands begins a step; the same object where nothing changes."""
        return state

    def told_near(self, state: Any, pose: Pose, things: Obstacles, across: Obstacles, floor_seen: bool) -> Any:
        """The state of one car that is told, while it stands, what is right before it.

        Args:
            state: before.
            pose: where the car is, without dimensions.
            things: that are near.
            across: places across the path: something is believed there where no floor is seen.
            floor_seen: right ahead.
        """
        return state

    def glances(self, state: Any) -> Glance:
        """What one car wants to be told while it drives; nothing by default."""
        return Glance()

    def told_more(self, state: Any, pose: Pose, ranges: Ranges | None, things: Obstacles | None) -> Any:
        """The state of one car that is told what it wanted, see `glances`.

        Args:
            state: before.
            pose: where the car is, without dimensions.
            ranges: of places of the left row that were searched for in the right one, `[n]`; None where it did not ask.
            things: that are near; None where it did not ask.
        """
        return state

    def told_place(self, state: Any, pose: Pose, place: Pose | None) -> Any:
        """The state of one car that is told where it is; steps that one kernel makes whole do not tell.

        Args:
            state: before.
            pose: where dead reckoning has led, without dimensions; the controller goes on to steer by it.
            place: where the car is as far as known; None while it looks for itself in a known map.
        """
        return state

    def caution(self, command: Command, state: Any, pose: Pose) -> tuple[Command, Any]:
        """The command that may be given of the one that is wanted, and the state that goes with it."""
        return command, state

    def settled(self, state: Any) -> bool:
        """Whether one car goes on from this state after it stood; else it begins anew, where it believes to be."""
        return False

    def trouble(self, state: Any) -> str | None:
        """Why one car stands or goes slowly, in words; None while it sees what it needs."""
        return None

    def warm_up(self) -> None:
        """Have ready what only later steps need, before a car depends on it."""

    def see(self, left: Tensor, right: Tensor, state: FilterState | None = None) -> tuple[Tensor, FilterState]:
        """What there is to steer by in frames `[..., T, C, H, W]`, and the state of the filters."""
        seen: tuple[Tensor, FilterState] = self.look(left, right, state)
        return seen

    def forward(
        self, seen: Tensor, ranges: Ranges, pose: Pose, driven: Command, state: Any = None
    ) -> tuple[Command, Any]:
        if pose.x.ndim < 1 or ranges.x.shape[:-1] != pose.x.shape or seen.shape[: pose.x.ndim] != pose.x.shape:
            raise InputError(
                f"expected poses [..., T], and what is seen [..., T, ...] and ranges [..., T, n] from there, got "
                f"{tuple(pose.x.shape)}, {tuple(seen.shape)} and {tuple(ranges.x.shape)}"
            )
        if driven.speed.shape != pose.x.shape or driven.curvature.shape != pose.x.shape:
            raise InputError(f"expected what was driven on the way to each pose, got {tuple(driven.speed.shape)}")
        dim, commands = pose.x.ndim - 1, []
        for t in range(pose.x.shape[-1]):
            here, moved = Pose(*(part[..., t] for part in pose)), Command(*(part[..., t] for part in driven))
            now = seen.select(dim, t)
            if state is None:
                state = self.start(now, here)
            command, state = self.step(now, ranges_at(ranges, t), here, moved, state)
            commands.append(command)
        return stack_commands(commands), state


def ranges_at(ranges: Ranges, t: int) -> Ranges:
    """Ranges `[..., T, n]` of one frame, `[..., n]`."""
    return Ranges(*(part[..., t, :] for part in ranges))


def stack_commands(commands: list[Command]) -> Command:
    """Commands `[...]` of frame after frame as `[..., T]`."""
    speed, curvature = zip(*commands, strict=True)
    return Command(in_time(speed), in_time(curvature))


def in_time(values: Sequence[Tensor]) -> Tensor:
    """Values `[...]` of frame after frame as `[..., T]`. Of one frame they are a view."""
    return values[0].unsqueeze(-1) if len(values) == 1 else torch.stack(list(values), -1)
