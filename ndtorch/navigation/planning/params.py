"""Parameters of the planner."""

from __future__ import annotations

from dataclasses import dataclass

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError


@dataclass(frozen=True)
class PlannerParams:
    """Parameters of costmap, lattice A* and frontiers. A cost is a length: of a metre more, where nothing else is said.

    Args:
        min_turn_radius_m: This is the radius of the tightest arc.
        footprint_radius_m: This is the radius of the discs that cover the body.
        footprint_centers_m: These are the centres of the discs along the body.
        safety_margin_m: This much is kept free around the discs.
        inflation_radius_m: A path costs nothing more from this clearance of the discs on.
        step_m: This is the length of the arcs of the lattice.
        horizon_m: This is the length of a planned path.
        plan_interval_s: A path is planned every so many seconds.
        clearance_cost: A metre costs up to this much more below the inflation radius.
        unknown_cost: A metre into unknown cells costs this much more.
        unseen_cost: A metre costs this much more if the leading half of the body covers unknown cells.
        unseen_horizon_m: The unseen cost counts up to this driven distance; what is farther will have been seen.
        curvature_cost: A metre costs this much more for each unit of curvature.
        curvature_change_cost: A change of the curvature by one unit costs this much.
        reverse_cost_ratio: Driving backward costs this many times as much.
        direction_change_cost: A change between forward and backward costs this much.
        obstacle_cost: A metre through obstacles costs this much more if no other path leads to the goal.
        blind_distance_m: Exploring, the first metres lead over no unknown cells, as no camera sees the floor there.
        lethal_radius_m: Exploring, no path has less clearance than this.
        hidden_depth_m: Unknown cells this near to an obstacle count as obstacles, except when exploring.
        costmap_cells: A cell of the costmap is this many cells of the local map wide.
        min_seen_frontier_m2: An area that was seen and not visited is a frontier from this size on.
        min_unknown_frontier_m2: An unknown area beside floor is a frontier from this size on.
        unknown_frontier_cost_m: A path to an unknown frontier costs this much more than one to a seen frontier.
        max_nodes: A search expands no more nodes than this.

    Raises:
        InputError: A number is out of range.
    """

    min_turn_radius_m: float = 0.5
    footprint_radius_m: float = 0.19
    footprint_centers_m: tuple[float, ...] = (-0.1875, -0.0625, 0.0625, 0.1875)
    safety_margin_m: float = 0.05
    inflation_radius_m: float = 0.45
    step_m: float = 0.2
    horizon_m: float = 2.6
    plan_interval_s: float = 0.2
    clearance_cost: float = 1.5
    unknown_cost: float = 0.3
    unseen_cost: float = 1.0
    unseen_horizon_m: float = 1.0
    curvature_cost: float = 0.05
    curvature_change_cost: float = 0.05
    reverse_cost_ratio: float = 2.5
    direction_change_cost: float = 0.8
    obstacle_cost: float = 40.0
    blind_distance_m: float = 0.45
    lethal_radius_m: float = 0.12
    hidden_depth_m: float = 0.15
    costmap_cells: int = 2
    min_seen_frontier_m2: float = 0.1
    min_unknown_frontier_m2: float = 0.3
    unknown_frontier_cost_m: float = 3.0
    max_nodes: int = 12000

    def __post_init__(self) -> None:
        positive = ("min_turn_radius_m", "footprint_radius_m", "step_m", "horizon_m", "costmap_cells", "max_nodes")
        check_numbers(self, positive=positive)
        if not self.footprint_centers_m:
            raise InputError("footprint_centers_m must be one place or more")
        if not self.inflation_radius_m > self.min_clearance_m:
            raise InputError(
                "inflation_radius_m must be more than footprint_radius_m + safety_margin_m, "
                f"{self.min_clearance_m:g} m, got {self.inflation_radius_m}"
            )

    @property
    def min_clearance_m(self) -> float:
        """Clearance that the centres of the discs keep."""
        return self.footprint_radius_m + self.safety_margin_m
