"""Parameters of the goal controller."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.local_grid.grid import LocalGridParams
from ndtorch.navigation.planning.params import PlannerParams


def reactive_params() -> RangingParams:
    """Parameters of the reactive controller under a planner: a large memory that lasts, and less room."""
    return RangingParams(
        safety_margin_m=0.03,
        grid=LocalGridParams(cell_m=0.05, size_cells=512, lifetime_s=120.0),
        min_free_m=0.15,
        overhangs=False,
    )


@dataclass(frozen=True)
class GoalParams:
    """Parameters of the goal controller.

    Args:
        goal: The car drives to this place, x and y in m in the frame of dead reckoning; None for no goal.
        explore: The car then drives wherever it was not yet; it does so without any other task, too.
        return_home: The car then drives back to where it began.
        goal_tolerance_m: A goal is reached within this distance.
        speed_m_per_s: The car drives at this speed where there is room.
        tight_speed_m_per_s: The car drives at this speed where it is tight.
        unknown_speed_m_per_s: The car drives at this speed into unknown cells where it could not brake before them.
        deceleration_m_per_s2: The car can brake with this deceleration.
        reaction_s: The car brakes this long after an obstacle came into view: two frames of ranges, a step, and the
            reaction of the body.
        max_curvature_per_m: No commanded curvature exceeds this, which is above that of the planned arcs.
        lookahead_m: Pure pursuit aims this far ahead along the path.
        visited_radius_m: Exploring, everything within this distance of the car is visited.
        visited_grid: This local grid remembers what is visited.
        exploration_timeout_s: Exploration ends if no path to a frontier was found for this long.
        no_progress_s: A frontier is given up if the car has come no nearer and visited nothing new for this long, and
            for the time that the path to it takes at the speed into unknown cells.
        blacklist_radius_m: A frontier is given up with everything within this distance.
        exploration_memory_s: Exploring, obstacles and floor are remembered for this long.
        miss_evidence: A range takes this much evidence from each cell on its line of sight.
        reactive: These parameters belong to the reactive controller.
        planner: These parameters belong to the planner.

    Raises:
        InputError: A number is not positive.
    """

    goal: tuple[float, float] | None = None
    explore: bool = False
    return_home: bool = False
    goal_tolerance_m: float = 0.3
    speed_m_per_s: float = 0.5
    tight_speed_m_per_s: float = 0.35
    unknown_speed_m_per_s: float = 0.3
    deceleration_m_per_s2: float = 1.5
    reaction_s: float = 0.2
    max_curvature_per_m: float = 2.15
    lookahead_m: float = 0.3
    visited_radius_m: float = 0.9
    visited_grid: LocalGridParams = field(default_factory=lambda: LocalGridParams(cell_m=0.1, size_cells=512))
    exploration_timeout_s: float = 10.0
    no_progress_s: float = 12.0
    blacklist_radius_m: float = 0.5
    exploration_memory_s: float = 600.0
    miss_evidence: float = 0.15
    reactive: RangingParams = field(default_factory=reactive_params)
    planner: PlannerParams = field(default_factory=PlannerParams)

    def __post_init__(self) -> None:
        check_numbers(self, positive=vars(self))
        if self.goal is not None and not (isinstance(self.goal, tuple | list) and len(self.goal) == 2):
            raise InputError(f"goal must be x and y in metres, got {self.goal!r}")


def with_memory(params: GoalParams, lifetime: float) -> GoalParams:
    """The same parameters with another lifetime of the evidence of obstacles and floor, s."""
    grid = replace(params.reactive.grid, lifetime_s=lifetime)
    return replace(params, reactive=replace(params.reactive, grid=grid))
