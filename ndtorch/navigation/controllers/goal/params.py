"""All numbers of the goal controller."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.local_grid.grid import LocalGridParams
from ndtorch.navigation.local_grid.motion_primitives import Body
from ndtorch.navigation.planning.params import PlannerParams


def reactive_params() -> RangingParams:
    """The reactive controller's numbers where a planner leads it: a large memory that lasts, and less room."""
    return RangingParams(
        body=Body(room=0.03),
        grid=LocalGridParams(cell=0.05, size=512, lifetime=120.0),
        min_free_m=0.15,
        overhangs=False,
    )


@dataclass(frozen=True)
class GoalParams:
    """The numbers of the goal controller.

    Args:
        to: the goal, x, y in m, where dead reckoning has its own origin; None for no goal.
        explore: then drive wherever it was not yet; the errand where no other is given.
        back: then go back to where the drive began.
        arrived: a goal is reached this near to it, m.
        speed: cruise speed, m/s.
        slow, creep: m/s where it is tight, and into what was not seen yet.
        braking: deceleration that is counted on, m/s^2.
        lag: distance that is driven before anything is done, m.
        tightest: largest curvature, 1/m, to come back to a way whose arcs are a little wider.
        ahead: the way is followed by aiming so far ahead, m.
        passed: exploring, places within this of the way driven count as done, m.
        places: the memory of them; it reaches farther than that of what was seen.
        patience: exploring ends when for so long no way to anywhere new was found, s.
        in_vain: a place to explore is given up when the car has come no nearer and passed nothing new for so long,
            s, and for as long as creeping there takes.
        given_up: with all that is within this of it, m.
        lifetime: of what is remembered when exploring, s.
        miss: evidence that a range takes away from each cell before it.
        reactive: numbers of the controller that keeps the last word.
        planner: parameters of the planner.
    """

    to: tuple[float, float] | None = None
    explore: bool = False
    back: bool = False
    arrived: float = 0.3
    speed: float = 0.5
    slow: float = 0.35
    creep: float = 0.3
    braking: float = 1.5
    lag: float = 0.1
    tightest: float = 2.15
    ahead: float = 0.3
    passed: float = 0.9
    places: LocalGridParams = field(default_factory=lambda: LocalGridParams(cell=0.1, size=512))
    patience: float = 10.0
    in_vain: float = 12.0
    given_up: float = 0.5
    lifetime: float = 600.0
    miss: float = 0.15
    reactive: RangingParams = field(default_factory=reactive_params)
    planner: PlannerParams = field(default_factory=PlannerParams)

    def __post_init__(self) -> None:
        check_numbers(self)
        if self.to is not None and not (isinstance(self.to, tuple | list) and len(self.to) == 2):
            raise InputError(f"to must be x and y in metres, got {self.to!r}")
        for name, value in vars(self).items():
            if isinstance(value, float | int) and not isinstance(value, bool) and not value > 0:
                raise InputError(f"{name} must be a number > 0, got {value}")


def remembering(params: GoalParams, lifetime: float) -> GoalParams:
    """The same numbers, with another time for which is remembered what was seen, s."""
    grid = replace(params.reactive.grid, lifetime=lifetime)
    return replace(params, reactive=replace(params.reactive, grid=grid))
