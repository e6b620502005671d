"""A path through the local map: costmap, Dijkstra, and A* on a lattice of arcs."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.navigation.planning._kernels import Floats, Frame, LatticeParams, Layers, dijkstra, lattice_astar
from ndtorch.navigation.planning.costmap import LocalMap, clear_footprint, costmap, downscale, unseen_cells
from ndtorch.navigation.planning.params import PlannerParams


class Plan(NamedTuple):
    """A planned path.

    Attributes:
        path: `[n, 5]`: x, y, heading, curvature driven to there, direction; the first row is the start. One row: none.
        cost: of the path from the start to a goal; inf if none can be reached.
        clear, unseen: clearance, and `unseen_cells` of the footprint.
        to_go: `dijkstra` of each coarse cell, as far as was needed.
    """

    path: Floats
    cost: float
    clear: Floats
    unseen: Floats
    to_go: Floats


def goal_costs(local_map: LocalMap, place: tuple[float, float], params: PlannerParams) -> Floats:
    """Cost of ending in each coarse cell: at a place, or on the border towards it if it is outside."""
    m, by = local_map, params.costmap_cells
    rows, columns = (n // by for n in m.blocked.shape)
    costs = np.full((rows, columns), np.inf, np.float32)
    side = m.cell * by
    row, column = int((place[1] - m.bottom) // side), int((place[0] - m.left) // side)
    if 0 <= row < rows and 0 <= column < columns:
        costs[row, column] = 0.0
        return costs
    border = np.zeros(costs.shape, bool)
    border[[0, -1]], border[:, [0, -1]] = True, True
    r, c = np.nonzero(border)
    costs[r, c] = np.hypot(m.left + (c + 0.5) * side - place[0], m.bottom + (r + 0.5) * side - place[1])
    return costs


def plan(
    local_map: LocalMap,
    clear: Floats,
    goals: Floats,
    pose: tuple[float, float, float],
    curvature: float,
    direction: float,
    params: PlannerParams,
    through: bool = True,
) -> Plan:
    """The path of the next metres towards one of the goals.

    Args:
        clear: `clearance` of the local map.
        goals: `goal_costs` or `frontiers.frontier_costs`.
        pose: x, y, m, and heading, radians, of the car.
        curvature, direction: that it drives, 1/m and +1 or -1.
        through: as in `costmap`, and over unknown cells, however near. Without it a car that is too near to an
            obstacle may leave all the same.
    """
    m, p = local_map, params
    row, column = m.cell_of(pose[0], pose[1])
    cost, side = costmap(clear, m.unknown, p, through), m.cell * p.costmap_cells
    if not through:
        here = (row // p.costmap_cells, column // p.costmap_cells)
        clear_footprint(cost, downscale(clear, p.costmap_cells), here, side, p)
    rows, columns = cost.shape
    index = min(row // p.costmap_cells, rows - 1) * columns + min(column // p.costmap_cells, columns - 1)
    to_go = dijkstra(cost, goals, side, index, 2.0 * p.horizon_m + 2.0)
    start = np.array((*pose, curvature, direction), np.float32)
    unseen = unseen_cells(m.unknown, m.cell, p.footprint_radius_m)
    if not math.isfinite(to_go.ravel()[index]):
        return Plan(start[None], math.inf, clear, unseen, to_go)
    frames = Frame(m.left, m.bottom, m.cell), Frame(m.left, m.bottom, side)
    layers = Layers(clear, m.unknown.astype(np.float32), unseen, to_go, *frames)
    tight = 1 / p.min_turn_radius_m
    curvatures = np.array((0.0, tight / 2, -tight / 2, tight, -tight), np.float32)
    numbers = LatticeParams(
        step=p.step_m,
        horizon=p.horizon_m,
        min_clearance=p.min_clearance_m,
        inflation_radius=p.inflation_radius_m,
        clearance_cost=p.clearance_cost,
        unknown_cost=p.unknown_cost,
        unseen_cost=p.unseen_cost,
        unseen_horizon=p.unseen_horizon_m,
        curvature_cost=p.curvature_cost,
        curvature_change_cost=p.curvature_change_cost,
        reverse_cost_ratio=p.reverse_cost_ratio,
        direction_change_cost=p.direction_change_cost,
        blind_distance=0.0 if through else p.blind_distance_m,
        max_nodes=p.max_nodes,
    )
    path = lattice_astar(layers, start, curvatures, np.array(p.footprint_centers_m, np.float32), numbers)
    return Plan(path, float(to_go.ravel()[index]), clear, unseen, to_go)
