"""What a controller is: what it reads of each camera, what it makes of that, and how it steers by it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, NamedTuple

from torch import nn

from ndtorch.errors import InputError
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity import Obstacles, ProximityScan
from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch.navigation.stereo.rig import Rect, StereoRig

CRUISE, TURN, SUPPRESSED, STOPPED, REVERSE, ARRIVED = 0, 1, 2, 3, 4, 5
"""What a controller can be doing, the numbers of `Controller.mode`."""


class Command(NamedTuple):
    """What the car is to do: `speed` in m/s and `curvature` in 1/m, positive to the left; tensors or numbers."""

    speed: Any
    curvature: Any


@dataclass(frozen=True)
class Trace:
    """What a figure or a viewer draws of a controller, beside the speeds on both sides and its modes.

    Args:
        difference: what the `difference` of the state is, in words; positive where the car should rather turn left.
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

    The module holds what is fixed, and its state, a NamedTuple, is passed in and out. Of that, `difference` is drawn:
    what the controller weighs, positive where the car should rather turn left. With the backend `"torch"` all is
    tensors: what is seen, ranges `[..., n]`, poses and commands `[...]` of one frame. With `"numba"` it is arrays
    and numbers of one car, ranges `[n]`. Lengths are in units of the `Body`, metres for the car of [A].

    Attributes:
        name: by which it is chosen.
        backend: `"numba"`, compiled steps of one car after the other, or `"torch"`, batched differentiable tensors. Two
            classes of one name may have one each.
        Params: dataclass of its numbers, all with defaults.
        modes: which of `CRUISE`, `TURN`, ... it can be in.
        has_goals: whether it accepts goals.
        checks_near: whether it wants to know what is near while it is stationary; its state then has a `mode`.
        params: its numbers.
        fields: the rectangles that it looks at, of the left and the right image.
        trace: what to draw of it.

    Args:
        rig: the camera pair.
        dt: time step, s.
        params: its numbers; the defaults where none are given.
    """

    name: ClassVar[str]
    Params: ClassVar[type[Any]]
    modes: ClassVar[tuple[int, ...]]
    backend: ClassVar[Literal["numba", "torch"]] = "torch"
    has_goals: ClassVar[bool] = False
    checks_near: ClassVar[bool] = False
    params: Any
    fields: tuple[Rect, Rect]
    trace: Trace

    def __init__(self, rig: StereoRig, dt: float, params: Any = None) -> None:
        super().__init__()
        self.params = self.Params() if params is None else params
        if not isinstance(self.params, self.Params):
            raise InputError(
                f"params must be {self.Params.__name__} for the {self.name} controller, got {type(params).__name__}"
            )

    @classmethod
    def params_for(
        cls,
        speed: float = 0.5,
        goal: tuple[float, float] | None = None,
        explore: bool = False,
        return_home: bool = False,
    ) -> Any:
        """The numbers with which the controller does what it is asked to, as `NavigatorOptions` has it.

        Raises:
            InputError: a goal, which only other controllers have.
        """
        if goal is not None or explore or return_home:
            raise InputError(f"the {cls.name} controller has no goals: use the controller goal")
        return replace(cls.Params(), speed_m_per_s=speed)

    @abstractmethod
    def see(self, frames: Any, state: Any = None) -> tuple[Any, Any, Any]:
        """What there is to steer by in one frame, image speeds on both sides to be drawn, `[..., 2]`, and the state of
        the filters.

        Args:
            frames: of both cameras, `(left, right)` of `[..., 1, C, H, W]`; `Frames` with `"numba"`.
            state: of the filters before; None begins with this frame.
        """

    @abstractmethod
    def start(self, seen: Any, pose: Pose) -> Any:
        """The state before the first frame, in which `seen` is seen from `pose`."""

    @abstractmethod
    def step(self, seen: Any, ranges: Ranges, pose: Pose, driven: Command, state: Any) -> tuple[Command, Any]:
        """One frame: remember, decide, and limit the speed.

        Args:
            seen: of `see`.
            ranges: of the frame.
            pose, driven: where the car is, and what it drove to get there.
            state: of the controller before.
        """

    def mode(self, state: Any) -> Any:
        """What the car is doing: one of `modes`."""
        return state.mode

    def on_near_obstacles(self, state: Any, pose: Pose, scan: ProximityScan) -> Any:
        """The state of one standing car at a pose after a proximity check."""
        return state

    def look_again(
        self, state: Any, pose: Pose, search: Callable[[], Ranges | None], near: Callable[[], Obstacles]
    ) -> Any:
        """The state of one car after its command, when there is time to look for more.

        Args:
            search: ranges by a search of the rows; None where these are what every step gets.
            near: what is too near to be ranged.
        """
        return state

    def on_pose(self, state: Any, pose: Pose, place: Pose) -> Any:
        """The state of one car whose pose was corrected; called of controllers that have goals.

        Args:
            state: before.
            pose: where dead reckoning has led; the controller goes on to steer by it.
            place: where the car is.
        """
        return state

    def on_goal(self, state: Any, goal: tuple[float, float]) -> Any:
        """The state of one car that is sent to another place, in place of all that it was asked to do."""
        return state

    def can_resume(self, state: Any) -> bool:
        """Whether one car goes on from this state after it stood; else it begins anew at the same pose."""
        return False

    def status_message(self, state: Any) -> str | None:
        """Why one car stands or goes slowly; None while it sees what it needs."""
        return None

    def warm_up(self) -> None:
        """Compile or load what only later steps need, before a car depends on it."""
