"""All numbers of the goal controller."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ndtorch.arguments import check_numbers, check_signs
from ndtorch.errors import InputError
from ndtorch.navigation.controllers.ranging.arcs import Body
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.controllers.ranging.patch import PatchParams


def reactive_params() -> RangingParams:
    """The reactive controller's numbers where a planner leads it: a large memory that lasts, and less room."""
    return RangingParams(
        body=Body(room=0.03),
        patch=PatchParams(cell=0.05, size=512, lifetime=120.0),
        least=0.15,
        overhangs=False,
    )


@dataclass(frozen=True)
class WayParams:
    """How ways are planned.

    Args:
        radius: of the tightest arc, m.
        disc: radius of the discs that stand for the body, m, and `discs` the places of their middles along it.
        margin: kept free around them, m.
        soft: clearance of the discs from which on a way costs nothing more, m.
        step: length of the arcs of the lattice, m.
        horizon: length of a way, m.
        every: time between two plans, s.
        tight_price, unknown_price, hidden_price, seen_soon, bend_price, swing_price, reverse_price, switch_price: see
            `kernels.find_way`.
        blocked_price: of a metre through what is blocked, where there is no other way to the goal.
        blind: exploring, the next so many metres lead over nothing that was not seen: no camera sees floor there.
        shut: exploring, no way leads nearer than this to what is blocked, m.
        coarse: cells of the map along a side of one for the way to the goal.
        least_seen, least_unseen: exploring, a place is worth a way from this area on, m^2, seen or not.
        unseen_end: what ending in a place never seen costs more than in one that was seen and never passed, m.
        most: nodes that a search looks at.

    Raises:
        InputError: numbers out of range.
    """

    radius: float = 0.5
    disc: float = 0.19
    discs: tuple[float, ...] = (-0.1875, -0.0625, 0.0625, 0.1875)
    margin: float = 0.05
    soft: float = 0.45
    step: float = 0.2
    horizon: float = 2.6
    every: float = 0.2
    tight_price: float = 1.5
    unknown_price: float = 0.3
    hidden_price: float = 1.0
    seen_soon: float = 1.0
    bend_price: float = 0.05
    swing_price: float = 0.05
    reverse_price: float = 2.5
    switch_price: float = 0.8
    blocked_price: float = 40.0
    blind: float = 0.45
    shut: float = 0.12
    coarse: int = 2
    least_seen: float = 0.1
    least_unseen: float = 0.3
    unseen_end: float = 3.0
    most: int = 12000

    def __post_init__(self) -> None:
        check_numbers(self)
        check_signs(self, positive=("radius", "disc", "step", "horizon", "coarse", "most"))
        if not self.discs:
            raise InputError("discs must be one place or more")
        if not self.soft > self.disc + self.margin:
            raise InputError(f"soft must be more than disc + margin, {self.disc + self.margin:g} m, got {self.soft}")


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
        way: how ways are planned.
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
    places: PatchParams = field(default_factory=lambda: PatchParams(cell=0.1, size=512))
    patience: float = 10.0
    in_vain: float = 12.0
    given_up: float = 0.5
    lifetime: float = 600.0
    miss: float = 0.15
    reactive: RangingParams = field(default_factory=reactive_params)
    way: WayParams = field(default_factory=WayParams)

    def __post_init__(self) -> None:
        check_numbers(self)
        for name, value in vars(self).items():
            if isinstance(value, float | int) and not isinstance(value, bool) and not value > 0:
                raise InputError(f"{name} must be a number > 0, got {value}")


def remembering(params: GoalParams, lifetime: float) -> GoalParams:
    """The same numbers, with another time for which is remembered what was seen, s."""
    patch = replace(params.reactive.patch, lifetime=lifetime)
    return replace(params, reactive=replace(params.reactive, patch=patch))
