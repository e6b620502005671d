"""Parameters of the ranging controller."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ndtorch.arguments import check_numbers
from ndtorch.navigation.body import Body
from ndtorch.navigation.controllers.ranging.floor_view import FloorParams
from ndtorch.navigation.local_grid.grid import LocalGridParams


@dataclass(frozen=True)
class RangingParams:
    """Parameters of the ranging controller.

    Args:
        speed_m_per_s: The car drives at this speed ahead and in wide turns.
        tight_speed_m_per_s: The car drives at this speed in tight turns.
        reverse_speed_m_per_s: The car drives backward at this speed.
        unseen_speed_m_per_s: The car drives at this speed in turns that lead into what was not seen free.
        turn_radius_m: A wide turn has this radius.
        tight_radius_m: A tight turn has this radius.
        turn_below_m: A turn starts when less than this is free straight ahead.
        cruise_above_m: A turn ends when this is free straight ahead.
        wide_turn_min_m: A wide turn needs this free length; otherwise the tight one is taken.
        min_free_m: The car drives on while this is free; with less it reverses.
        min_turn_s: A turn lasts at least this long.
        reverse_m: The car reverses over this distance.
        reverse_until_free_m: Reversing ends early when this much is free on an arc ahead.
        side_hysteresis_m: The side to turn to changes only when the arcs on the other are longer by this.
        known_ratio: Arcs that are known to be floor count this share more when sides are compared.
        unknown_margin_m: Turns and reversing go at most this far into what was not seen free; inf lets them go
            anywhere.
        safety_margin_m: This much is kept free around the body.
        floor_evidence: A cell that looks like floor becomes free by this much in a frame.
        hidden_evidence: A cell in which the floor ends becomes blocked by this much in a frame.
        range_evidence: A cell with a range in it becomes blocked by this much in a frame.
        search_evidence: A cell with a range of a search in it becomes blocked by this much.
        miss_evidence: A range takes this much evidence from each cell on its line of sight, where `overhangs`.
        blocked_evidence: A cell is blocked from this evidence on, and known floor below minus a tenth of it.
        start_free_m: A car that does not know its floor yet begins only where this much is free straight ahead.
        min_noise_output: The 256 levels of an image alone make this output of the motion detectors.
        overhangs: What was ranged stays in the path although floor is seen there, as below sofas.
        search_interval_s: The right row is searched this often for what stands, where `overhangs`; in turns both rows
            are then compared for what is nearer than ranges are measured.
        boxed_in_memory_s: A car that is boxed in forgets with this time constant.
        body: This is the outline of the car.
        grid: These parameters belong to the local grid.
        floor: These parameters belong to the view of the floor.

    Raises:
        InputError: A number is not positive.
    """

    speed_m_per_s: float = 0.5
    tight_speed_m_per_s: float = 0.4
    reverse_speed_m_per_s: float = 0.3
    unseen_speed_m_per_s: float = 0.2
    turn_radius_m: float = 1.0
    tight_radius_m: float = 0.5
    turn_below_m: float = 1.1
    cruise_above_m: float = 1.4
    wide_turn_min_m: float = 1.3
    min_free_m: float = 0.2
    min_turn_s: float = 0.3
    reverse_m: float = 0.5
    reverse_until_free_m: float = 0.9
    side_hysteresis_m: float = 0.25
    known_ratio: float = 0.5
    unknown_margin_m: float = 0.1
    safety_margin_m: float = 0.07
    floor_evidence: float = 0.5
    hidden_evidence: float = 1.0
    range_evidence: float = 1.0
    search_evidence: float = 2.0
    miss_evidence: float = 0.15
    blocked_evidence: float = 1.9
    start_free_m: float = 0.7
    min_noise_output: float = 0.005
    overhangs: bool = True
    search_interval_s: float = 0.17
    boxed_in_memory_s: float = 1.0
    body: Body = field(default_factory=Body)
    grid: LocalGridParams = field(default_factory=LocalGridParams)
    floor: FloorParams = field(default_factory=FloorParams)

    def __post_init__(self) -> None:
        check_numbers(self, endless=["unknown_margin_m"], positive=vars(self))

    def no_faster(self, speed: float) -> RangingParams:
        """The parameters of a car that drives at this speed: it turns, backs and goes into the unseen no faster."""
        return replace(
            self,
            tight_speed_m_per_s=min(self.tight_speed_m_per_s, 0.8 * speed),
            reverse_speed_m_per_s=min(self.reverse_speed_m_per_s, speed),
            unseen_speed_m_per_s=min(self.unseen_speed_m_per_s, speed),
        )
