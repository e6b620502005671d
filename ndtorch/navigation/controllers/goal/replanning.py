"""A new path from where the car is: the local map and the visited cells around it, a plan, and its speeds."""

from __future__ import annotations

import math

import numpy as np

from ndtorch.navigation.controllers.goal.params import GoalParams
from ndtorch.navigation.controllers.goal.tasks import MAX_POINTS, GoalState, task_goal
from ndtorch.navigation.controllers.ranging.control import BLOCKED
from ndtorch.navigation.local_grid._kernels import Array
from ndtorch.navigation.local_grid.grid import LocalGridParams, cells_at
from ndtorch.navigation.planning._kernels import Floats
from ndtorch.navigation.planning.costmap import Bools, LocalMap, clearance, with_backs
from ndtorch.navigation.planning.frontiers import cheapest_goal, frontier_costs
from ndtorch.navigation.planning.path_tracking import SpeedLimits, seen_points, speed_profile
from ndtorch.navigation.planning.planner import Plan, goal_costs, plan

FREE_RATIO = 0.1
"""Cells with less evidence than minus this share of a blocked cell's are free."""

SPIN_LOOK_M = 0.6
"""The heading of the path of a differential drive is that to the place so far down the costs to the goal."""

SPIN_ABOVE, SPIN_BELOW = math.radians(60), math.radians(15)
"""It turns on the spot where that heading is farther off than the first, until it is nearer than the second."""

PROGRESS_M = 0.1
"""A path to a frontier that costs this much less than before is progress."""


def replan(state: GoalState, here: tuple[float, float, float], params: GoalParams, every: int) -> GoalState:
    """The state with a new path.

    Args:
        here: x, y, m, and heading, radians.
        every: time steps until the next plan.
    """
    p, grid, blocked = params, params.reactive.grid, BLOCKED

    around = local_map(state.reactive.grid.evidence, here[0], here[1], grid, blocked, -FREE_RATIO * blocked)
    goal = task_goal(state, p)
    clear = clearance(around.blocked if goal is None else with_backs(around, p.planner.hidden_depth_m), around.cell)
    if goal is None:
        visited = visited_cells(state.visited.evidence, here[0], here[1], grid, p.visited_grid)
        goals = frontier_costs(around, visited, clear, p.planner)
    else:
        goals = goal_costs(around, goal, p.planner)
    at = min(state.at + 1, max(0, state.points - 1))
    curvature = float(state.path[at, 3]) if state.points else 0.0
    made = plan(around, clear, goals, here, curvature, float(state.direction), p.planner, through=goal is not None)
    if goal is None:
        state = check_progress(state, made, around, here, p)
    limits = SpeedLimits(
        p.speed_m_per_s,
        p.tight_speed_m_per_s,
        p.reactive.reverse_speed_m_per_s,
        p.deceleration_m_per_s2,
    )
    points = min(len(made.path), MAX_POINTS)
    path = np.zeros((MAX_POINTS, 6), np.float32)
    path[:points, :5] = made.path[:points]
    path[:points, 5] = speed_profile(made, around, limits, p.planner)[:points]
    turn_to = math.inf
    if p.reactive.body.spins and math.isfinite(made.cost):
        heading = path_heading(made.to_go, around, here, p.planner.costmap_cells)
        turn_to = heading if abs(math.remainder(heading - here[2], math.tau)) > SPIN_ABOVE else math.inf
    return state._replace(
        path=path,
        points=points if points > 1 else 0,
        seen=min(seen_points(made, around, p.planner), points),
        turn_to=turn_to,
        at=0,
        due=every,
        cost=float(made.cost),
    )


def path_heading(to_go: Floats, around: LocalMap, here: tuple[float, float, float], cells: int) -> float:
    """Heading from here to the place `SPIN_LOOK_M` down the costs of `dijkstra`, radians; NaN where they end here."""
    row, column = (n // cells for n in around.cell_of(here[0], here[1]))
    side = around.cell * cells
    start = row, column
    for _ in range(round(SPIN_LOOK_M / side)):
        top, left = max(row - 1, 0), max(column - 1, 0)
        beside = to_go[top : row + 2, left : column + 2]
        down, aside = divmod(int(beside.argmin()), beside.shape[1])
        row, column = top + down, left + aside
    moved = row - start[0], column - start[1]
    return math.atan2(*moved) if any(moved) else math.nan


def check_progress(
    state: GoalState, made: Plan, around: LocalMap, here: tuple[float, float, float], params: GoalParams
) -> GoalState:
    """The state of an exploring car after a plan; a frontier without progress for too long counts as visited."""
    p, grid = params, params.visited_grid
    if math.isinf(made.cost):
        return state
    visited = float(state.visited.evidence.sum())
    newly = (visited - state.visited_before) * grid.cell_m**2
    if newly >= p.planner.min_seen_frontier_m2 or made.cost < state.best_cost - PROGRESS_M:
        return state._replace(best_cost=float(made.cost), visited_before=visited, no_progress_s=0.0)
    # Another frontier may be far away and is no progress: goals may alternate.
    if state.no_progress_s < p.no_progress_s + made.cost / p.unknown_speed_m_per_s:
        return state
    frontier = cheapest_goal(made.to_go, around, p.planner.costmap_cells, here[:2])
    evidence = mark_visited(state.visited.evidence, *frontier, p.blacklist_radius_m, grid)
    return state._replace(
        visited=state.visited._replace(evidence=evidence),
        best_cost=math.inf,
        visited_before=float(evidence.sum()),
        no_progress_s=0.0,
    )


def first_cell(x: float, y: float, params: LocalGridParams) -> tuple[int, int]:
    """Indices of the cell at the lower left corner of a grid around a place."""
    half = params.size_cells // 2
    return math.floor(x / params.cell_m) - half + 1, math.floor(y / params.cell_m) - half + 1


def unrolled(evidence: Array, x: float, y: float, params: LocalGridParams) -> Floats:
    """Evidence `[size, size]` as rows of y and columns of x around a place, both growing."""
    size, (left, bottom) = params.size_cells, first_cell(x, y, params)
    return np.ascontiguousarray(np.roll(evidence, (-left % size, -bottom % size), (0, 1)).T)


def local_map(evidence: Array, x: float, y: float, params: LocalGridParams, blocked: float, free: float) -> LocalMap:
    """The local map around a car.

    Args:
        evidence: `[size, size]` of a `LocalGrid`.
        x, y: the car.
        blocked, free: evidence from which a cell is blocked, and below which it is free.
    """
    cells = unrolled(evidence, x, y, params)
    left, bottom = first_cell(x, y, params)
    return LocalMap(cells >= blocked, cells < free, left * params.cell_m, bottom * params.cell_m, params.cell_m)


def visited_cells(visited: Array, x: float, y: float, params: LocalGridParams, grid: LocalGridParams) -> Bools:
    """Which cells are visited, laid out as `local_map` with these params; `grid` are those of `visited`."""
    wide = unrolled(visited, x, y, grid) > 0.5
    index = []
    for near, far in zip(first_cell(x, y, params), first_cell(x, y, grid), strict=True):
        middle = (np.arange(params.size_cells) + near + 0.5) * params.cell_m
        index.append(np.clip(np.floor(middle / grid.cell_m).astype(int) - far, 0, grid.size_cells - 1))
    columns, rows = index
    return np.ascontiguousarray(wide[np.ix_(rows, columns)])


def disc_cells(radius: float, params: LocalGridParams) -> Array:
    """Points of the body frame that fill a disc, a cell apart, `[2, n]`, m."""
    reach = math.floor(radius / params.cell_m)
    line = np.arange(-reach, reach + 1, dtype=np.float32) * np.float32(params.cell_m)
    x, y = np.meshgrid(line, line, indexing="ij")
    inside = x * x + y * y <= radius**2
    return np.stack((x[inside], y[inside]))


def mark_visited(visited: Array, x: float, y: float, radius: float, params: LocalGridParams) -> Array:
    """The visited cells with everything within a radius of a place, m."""
    marked = visited.copy()
    ahead, left = disc_cells(radius, params)
    marked.reshape(-1)[cells_at((x, y, 0.0), ahead, left, params)] = 1.0
    return marked
