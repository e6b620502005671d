"""What a controller is, and controllers by name: those in this folder are found by themselves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar, Literal, NamedTuple, TypeVar

from torch import nn

from ndtorch.errors import InputError
from ndtorch.navigation.body import Body, params_for_body
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity import Obstacles, ProximityScan
from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch.utils.registry import Registry

CRUISE, TURN, SUPPRESSED, STOPPED, REVERSE, ARRIVED = 0, 1, 2, 3, 4, 5
"""What a controller can be doing, the numbers of `Controller.mode`."""


class Command(NamedTuple):
    """What the car is to do: `speed` in m/s and `curvature` in 1/m, positive to the left; tensors or numbers."""

    speed: Any
    curvature: Any


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

    def __init__(self, rig: StereoRig, dt: float, params: Any = None) -> None:
        super().__init__()
        self.params = self.Params() if params is None else params
        if not isinstance(self.params, self.Params):
            raise InputError(
                f"params must be {self.Params.__name__} for the {self.name} controller, got {type(params).__name__}"
            )

    @classmethod
    def params_for(cls, speed: float, **tasks: Any) -> Any:
        """The numbers with which the controller does what it is asked to: `goal`, `explore`, `return_home`.

        Raises:
            InputError: a task, which only other controllers have.
        """
        if any(task not in (None, False) for task in tasks.values()):
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

    def look_again(self, state: Any, pose: Pose, near: Callable[[], Obstacles]) -> Any:
        """The state of one car after its command, when there is time for `near`: what is too near to be ranged."""
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


DEFAULT_CONTROLLER = "ranging"

AnyController = TypeVar("AnyController", bound=type[Controller])

CONTROLLERS: Registry[dict[str, type[Controller]]] = Registry("controller", __name__.rpartition(".")[0])
"""Classes by name and backend."""


def register(kind: AnyController) -> AnyController:
    """Class decorator: the controller can be chosen by its `name` and `backend` from then on.

    Raises:
        InputError: another controller has both.
    """
    known = CONTROLLERS.setdefault(kind.name, {}).setdefault(kind.backend, kind)
    if known.__qualname__ != kind.__qualname__:
        raise InputError(f"there is a controller {kind.name!r} already, {known.__module__}.{known.__qualname__}")
    return kind


def controller_names() -> tuple[str, ...]:
    """The names of all controllers, the default first.

    >>> controller_names()
    ('ranging', 'goal', 'published')
    """
    return (DEFAULT_CONTROLLER, *sorted(CONTROLLERS.load().keys() - {DEFAULT_CONTROLLER}))


def controller_class(name: str, backend: str = "auto") -> type[Controller]:
    """The class of the controller of this name.

    Args:
        backend: `"numba"`, `"torch"`, or `"auto"` for the first of them that the controller has.

    Raises:
        InputError: no such controller, or not with this backend.
    """
    kinds = CONTROLLERS.find(name)
    for kind in ("numba", "torch"):
        if kind in kinds and backend in ("auto", kind):
            return kinds[kind]
    raise InputError(f"the {name} controller has the backend {' and '.join(sorted(kinds))}, got {backend!r}")


def make_controller(
    name: str, rig: StereoRig, dt: float, params: Any = None, backend: str = "auto", body: Body | None = None
) -> Controller:
    """The controller of this name for a camera pair and a time step.

    Args:
        params: its numbers, an instance of its `Params`; the defaults where none are given.
        backend: see `controller_class`.
        body: whose units all lengths of the controller are in; the car of [A], whose unit is a metre, by default.

    Raises:
        InputError: no such controller, or parameters of another one.

    >>> from ndtorch.navigation import StereoRig
    >>> type(make_controller('ranging', StereoRig(), 1 / 30)).__name__
    'RangingControl'
    """
    kind = controller_class(name, backend)
    if body is None:
        return kind(rig, dt, params)
    params = params_for_body(kind.Params() if params is None else params, body)
    try:
        return kind(rig.in_units(body.unit_m), dt, params)
    except InputError as error:
        raise InputError(f"{error} (lengths in units of the body, {body.unit_m:.3g} m)") from None
