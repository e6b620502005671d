"""Parameters of the ranging controller."""

from __future__ import annotations

from dataclasses import dataclass, field

from ndtorch.arguments import check_numbers
from ndtorch.navigation.body import Body
from ndtorch.navigation.local_grid import LocalGridParams


@dataclass(frozen=True)
class RangingParams:
    """Parameters of the ranging controller.

    Args:
        speed_m_per_s: Speed ahead and in wide turns.
        turn_radius_m: Radius of a wide turn.
        tight_radius_m: Radius of a tight turn.
        turn_below_m: A turn starts when less than this is free straight ahead.
        cruise_above_m: A turn ends when this is free straight ahead.
        min_free_m: The car drives on while this is free; with less it reverses.
        reverse_m: Distance over which the car reverses.
        safety_margin_m: Distance that is kept free around the body.
        overhangs: What was ranged stays in the path although floor is seen there, as below sofas.
        body: Outline of the car.
        grid: Parameters of the local grid.

    Raises:
        InputError: A number is not positive.
    """

    speed_m_per_s: float = 0.5
    turn_radius_m: float = 1.0
    tight_radius_m: float = 0.5
    turn_below_m: float = 1.1
    cruise_above_m: float = 1.4
    min_free_m: float = 0.2
    reverse_m: float = 0.5
    safety_margin_m: float = 0.07
    overhangs: bool = True
    body: Body = field(default_factory=Body)
    grid: LocalGridParams = field(default_factory=LocalGridParams)

    def __post_init__(self) -> None:
        check_numbers(self, positive=vars(self))

    @property
    def tight_speed_m_per_s(self) -> float:
        """Speed in tight turns."""
        return min(0.4, 0.8 * self.speed_m_per_s)

    @property
    def reverse_speed_m_per_s(self) -> float:
        """Speed backward."""
        return min(0.3, self.speed_m_per_s)
