"""All numbers of the ranging controller."""

from __future__ import annotations

from dataclasses import dataclass, field

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.controllers.ranging.floor_view import FloorParams
from ndtorch.navigation.local_grid.grid import LocalGridParams
from ndtorch.navigation.local_grid.motion_primitives import Body


@dataclass(frozen=True)
class RangingParams:
    """The numbers of the ranging controller.

    Args:
        speed, tight_speed, reverse_speed: m/s ahead and in wide turns, in tight turns, and backward.
        turn_radius, tight_radius: m.
        turn_below_m: a turn starts when less than this is free straight ahead, m.
        cruise_above_m: a turn ends when this is free straight ahead, m.
        wide_turn_min_m: free length that the wide turn needs, m; otherwise the tight one is taken.
        min_free_m: driving on needs this much, m; with less the car reverses.
        turn_time: shortest turn, s.
        reverse_length: m.
        room: reversing ends early when this much is free on an arc ahead, m.
        side_hysteresis_m: the side to turn to changes only when the arcs on the other are longer by this, m.
        known_share: metres of arc that are known to be floor count this much extra when sides are compared.
        unknown_margin_m: turns and reversing shall go at most this far into what was not seen free, m; inf lets them go
            anywhere.
        floor_weight, hidden_weight, range_weight: evidence that a cell of floor, its end or a range gives a frame.
        blocked: evidence from which a cell counts as blocked; below minus a tenth of it the cell is known to
            be floor.
        start_needs: a car that does not know its floor yet begins only where this much is free straight ahead, m.
        least_noise: output of the motion detectors that the 256 levels of a picture alone can make.
        overhangs: what was ranged stays in the way although floor is seen there, as below sofas, see `overhangs`.
        miss_evidence: evidence that a range takes away from each cell before it, where `overhangs`.
        search_interval_s: time between two searches of the right row for what stands, where `overhangs`, s; in turns
            both rows are compared then for what is nearer than ranges are measured.
        search_weight: evidence that a range of such a search gives.
        fading: time constant at which a car that is boxed in forgets, s.
        body: outline of the car.
        grid: the memory.
        floor: the subfields.
    """

    speed: float = 0.5
    tight_speed: float = 0.4
    reverse_speed: float = 0.3
    turn_radius: float = 1.0
    tight_radius: float = 0.5
    turn_below_m: float = 1.1
    cruise_above_m: float = 1.4
    wide_turn_min_m: float = 1.3
    min_free_m: float = 0.2
    turn_time: float = 0.3
    reverse_length: float = 0.5
    room: float = 0.9
    side_hysteresis_m: float = 0.25
    known_share: float = 0.5
    unknown_margin_m: float = 0.1
    floor_weight: float = 0.5
    hidden_weight: float = 1.0
    range_weight: float = 1.0
    blocked: float = 1.9
    start_needs: float = 0.7
    least_noise: float = 0.005
    overhangs: bool = True
    miss_evidence: float = 0.15
    search_interval_s: float = 0.17
    search_weight: float = 2.0
    fading: float = 1.0
    body: Body = field(default_factory=Body)
    grid: LocalGridParams = field(default_factory=LocalGridParams)
    floor: FloorParams = field(default_factory=FloorParams)

    def __post_init__(self) -> None:
        check_numbers(self, endless=["unknown_margin_m"])
        for name, value in vars(self).items():
            if isinstance(value, float | int) and not isinstance(value, bool) and not value > 0:
                raise InputError(f"{name} must be a number > 0, got {value}")
