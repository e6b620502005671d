"""A path through the local map around a car: costmap, Dijkstra, and A* on a lattice of arcs; and its tracking."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.body import Body
from ndtorch.navigation.local_grid import Place
from ndtorch.utils.jit import jit

Floats = npt.NDArray[np.float32]
Bools = npt.NDArray[np.bool_]
FAR_M = 99.0  # clearance where there is no obstacle
HIDDEN_M = 0.15  # unknown cells this near to an obstacle count as obstacles
COARSE = 2  # a cell of the costmap is this many cells of the local map wide

NARROW_M = 0.03
"""Half a coarse cell is forgiven: a passage that just admits the car need not lie on the cells."""

OBSTACLE_COST = 40.0  # metres more for a metre through obstacles, where no other path leads to the goal
LETHAL_M = 0.12  # exploring, no path has less clearance than this
MAX_REVERSE_SPEED = 0.3  # m/s
DISCS = 4  # number of discs that cover the body

SPARE_RADIUS_RATIO = 0.9
"""Tightest turn of the body over that of a planned arc, so that the car can return to a path."""


MIN_SPEED = 0.08  # m/s: a car that tracks a path is not slower
REACHED_M = 0.02  # a point of the path is reached this far before the line across the path through it

STEP_M, HEADINGS, NODE_M = 0.2, 24, 0.1
"""Length of the arcs of the lattice, number of its headings, and side of the squares in which nodes are the same."""

MAX_NODES = 12000  # a search makes no more nodes than this
EXIT_M = 0.5  # a car that is too near to an obstacle may leave within this distance, but not go nearer
NOSE_M = 0.25  # unknown cells are looked for this far ahead of the body's origin

HORIZON_M, INFLATION_RADIUS_M = 2.6, 0.45
"""Length of a path, and clearance of the middle line of the body from which on it costs nothing more."""

CLEARANCE_COST, REVERSE_COST_RATIO = 1.5, 2.5
"""Metres more for a metre at the least clearance, and cost of driving backward over that of driving ahead."""

UNKNOWN_COST, CURVATURE_COST, CURVATURE_CHANGE_COST, DIRECTION_CHANGE_COST = 0.3, 0.05, 0.05, 0.8
"""Metres more for a metre into unknown cells, for each unit of curvature of a metre, for a change of the curvature by
one unit, and for a change between forward and backward."""


class LocalMap(NamedTuple):
    """A rectangle of the world in cells, row after row from the smallest y."""

    blocked: Bools  # blocked, free: obstacles and floor, `[rows, columns]`; neither is unknown
    free: Bools
    left: float  # left, bottom: lower left corner, m
    bottom: float
    cell: float  # side of a cell, m

    @property
    def unknown(self) -> Bools:
        return ~(self.free | self.blocked)

    def cells_of(self, x: Floats | float, y: Floats | float, coarse: int = 1) -> tuple[npt.NDArray[np.int64], ...]:
        """Rows and columns of the cells that hold points, or of the nearest ones."""
        at = zip((y, x), (self.bottom, self.left), self.blocked.shape, strict=True)
        side = self.cell * coarse
        return tuple(np.floor((v - low) / side).astype(int).clip(0, n // coarse - 1) for v, low, n in at)


class PlannedPath(NamedTuple):
    """A planned path."""

    # `[n, 6]`: x, y, heading, curvature driven to there, direction (+1 or -1), and speed, m/s; the first row
    # is the start. One row: none
    path: Floats
    cost: float  # of the path from the start to a goal; inf if none can be reached
    to_go: Floats  # `dijkstra` of each coarse cell, as far as was needed


@dataclass(frozen=True)
class PlannerParams:
    """Parameters of paths and of the speeds along them."""

    speed_m_per_s: float = 0.5  # speed where there is room
    tight_speed_m_per_s: float = 0.35  # speed where it is tight
    unknown_speed_m_per_s: float = 0.3  # speed into unknown cells
    deceleration_m_per_s2: float = 1.5  # deceleration with which the car can brake
    safety_margin_m: float = 0.05  # distance that is kept free around the body
    body: Body = field(default_factory=Body)  # outline and tightest turn of the car

    def __post_init__(self) -> None:
        check_numbers(self, positive=vars(self))
        if not self.min_clearance_m < INFLATION_RADIUS_M:
            raise InputError(f"body and safety_margin_m must be within {INFLATION_RADIUS_M} m, got {self}")

    @property
    def centers(self) -> Floats:
        """Centres of the discs that cover the body, along it, m."""
        return (((np.arange(DISCS) + 0.5) / DISCS - 0.5) * self.body.length_m).astype(np.float32)

    @property
    def radius_m(self) -> float:
        """Radius of these discs."""
        return math.hypot(self.body.length_m / (2 * DISCS), self.body.width_m / 2)

    @property
    def min_clearance_m(self) -> float:
        """Clearance that their centres keep."""
        return self.radius_m + self.safety_margin_m

    @property
    def max_curvature_per_m(self) -> float:
        """Curvature of the tightest arc that is planned."""
        return 1 / max(self.body.min_turn_radius_m / SPARE_RADIUS_RATIO, self.body.length_m)


def plan(
    p: PlannerParams,
    m: LocalMap,
    goals: Floats,
    pose: Place,
    curvature: float = 0.0,
    direction: float = 1.0,
    exploring: bool = False,
) -> PlannedPath:
    """The path of the next metres towards one of the goals.

    Args:
        m: the local map.
        goals: cost of ending in each coarse cell, see `goal_costs` and `unvisited_costs`.
        pose: of the car.
        curvature, direction: that it drives, 1/m and +1 or -1.
        exploring: no path leads through obstacles, except in gaps that seem a little too narrow: a few cells more or
            less decide about a door.
    """
    clear = clearance(m.blocked, m.cell)
    if not exploring:  # only the front of an obstacle is ranged
        clear = clearance(m.blocked | (m.unknown & (clear <= HIDDEN_M)), m.cell)
    side, (row, column) = m.cell * COARSE, m.cells_of(pose[0], pose[1], COARSE)
    near = downscale(clear)
    lack = (INFLATION_RADIUS_M - near) / (INFLATION_RADIUS_M - p.min_clearance_m)
    cost = 1.0 + CLEARANCE_COST * np.clip(lack, 0.0, 1.0) + UNKNOWN_COST * (downscale(~m.unknown) < 0.5)
    cost += OBSTACLE_COST * (near < p.min_clearance_m - NARROW_M)
    cost = np.where(exploring & (near < LETHAL_M), np.inf, cost).astype(np.float32)
    to_go = dijkstra(cost, goals, side, int(row * cost.shape[1] + column), 2.0 * HORIZON_M + 2.0)
    start = np.array((*pose, curvature, direction), np.float32)
    if not math.isfinite(to_go[row, column]):
        return PlannedPath(np.append(start, np.float32(0.0))[None], math.inf, to_go)
    frames = PathFrame(m.left, m.bottom, m.cell), PathFrame(m.left, m.bottom, side)
    layers, tight = Layers(clear, m.unknown.astype(np.float32), to_go, *frames), p.max_curvature_per_m
    curvatures = np.array((0.0, tight / 2, -tight / 2, tight, -tight), np.float32)
    path = lattice_astar(layers, start, curvatures, p.centers, p.min_clearance_m)
    path = np.column_stack((path, speed_profile(p, path, m, clear))).astype(np.float32)
    return PlannedPath(path, float(to_go[row, column]), to_go)


def unvisited_costs(p: PlannerParams, m: LocalMap, visited: Bools) -> Floats:
    """Cost of ending in each coarse cell when exploring: 0 on floor that was seen and not visited, else inf."""
    fits = m.free & ~visited & (clearance(m.blocked, m.cell) > p.min_clearance_m)
    # Lone cells are false: a goal is three cells wide.
    return downscale(np.where(opened(fits), np.float32(0.0), np.float32(np.inf)))


def speed_profile(p: PlannerParams, path: Floats, m: LocalMap, clear: Floats) -> Floats:
    """The speed at each point of a path `[n, 5]`, m/s: lower where it is tight and into unknown cells, 0 where the
    direction changes, and no higher than from where the car can brake to the speed of the next point."""
    x, y, heading, _, direction = path.astype(np.float64).T
    cos, sin = np.cos(heading), np.sin(heading)
    along = [m.cells_of(x + d * cos, y + d * sin) for d in p.centers.tolist()]
    ratio = np.min([clear[cells] for cells in along], 0) - p.min_clearance_m
    ratio = (ratio / (INFLATION_RADIUS_M - p.min_clearance_m)).clip(0.0, 1.0)
    speeds = p.tight_speed_m_per_s + max(0.0, p.speed_m_per_s - p.tight_speed_m_per_s) * ratio
    lead = direction * (p.centers[-1] + p.radius_m)
    # Single unknown cells do not count.
    unknown = opened(m.unknown)[m.cells_of(x + lead * cos, y + lead * sin)]
    speeds = np.where(unknown, np.minimum(speeds, p.unknown_speed_m_per_s), speeds)
    speeds = np.where(direction < 0, np.minimum(speeds, MAX_REVERSE_SPEED), speeds)
    speeds[:-1][direction[1:] != direction[:-1]] = 0.0
    lengths = np.hypot(np.diff(x), np.diff(y))
    for n in range(len(path) - 2, -1, -1):
        speeds[n] = min(speeds[n], math.sqrt(speeds[n + 1] ** 2 + 2 * p.deceleration_m_per_s2 * lengths[n]))
    return np.asarray(speeds, np.float32)


def clearance(blocked: Bools, cell: float) -> Floats:
    """Distance from each cell to the middle of the nearest blocked one, m."""
    import cv2

    if not blocked.any():
        return np.full(blocked.shape, FAR_M, np.float32)
    return np.asarray(cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, 5), np.float32) * np.float32(cell)


def opened(cells: Bools) -> Bools:
    """Areas without parts that are less than three cells wide."""
    import cv2

    return np.asarray(cv2.morphologyEx(cells.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0)


def downscale(values: npt.NDArray[np.generic]) -> Floats:
    """The minimum of each square of `COARSE` x `COARSE` cells."""
    rows, columns = (n // COARSE * COARSE for n in values.shape)
    rows_of_two = np.minimum(values[:rows:COARSE], values[1:rows:COARSE])
    return np.asarray(np.minimum(rows_of_two[:, :columns:COARSE], rows_of_two[:, 1:columns:COARSE]), np.float32)


def goal_costs(m: LocalMap, place: tuple[float, float]) -> Floats:
    """Cost of ending in each coarse cell: 0 at a place; on the border towards it if it is outside."""
    rows, columns = (n // COARSE for n in m.blocked.shape)
    costs, side = np.full((rows, columns), np.inf, np.float32), m.cell * COARSE
    row, column = int((place[1] - m.bottom) // side), int((place[0] - m.left) // side)
    if 0 <= row < rows and 0 <= column < columns:
        costs[row, column] = 0.0
        return costs
    r, c = np.indices(costs.shape)
    away = np.hypot(m.left + (c + 0.5) * side - place[0], m.bottom + (r + 0.5) * side - place[1])
    border = (r == 0) | (r == rows - 1) | (c == 0) | (c == columns - 1)
    return np.where(border, away, np.inf).astype(np.float32)


class Pursuit(NamedTuple):
    """How to drive to stay on a path."""

    direction: float  # +1 ahead, -1 backward, 0 where the path has ended
    curvature: float  # 1/m
    at: int  # index of the point of the path that the car has reached


def pure_pursuit(path: Floats, at: int, pose: Place, lookahead: float, max_curvature: float) -> Pursuit:
    """Pursue a point of the path some distance ahead, on the stretch that has one direction [Coulter 1992].

    Args:
        path: of `PlannedPath`.
        at: index of the point reached before.
        pose: x, y, heading of the car.
        lookahead: distance of the point along the path, m; beyond the end of the stretch straight on.
        max_curvature: 1/m.
    """
    x, y, heading = pose
    while at + 1 < len(path):
        dx, dy, turned, direction = x - path[at + 1, 0], y - path[at + 1, 1], path[at + 1, 2], path[at + 1, 4]
        if direction * (dx * math.cos(turned) + dy * math.sin(turned)) < -REACHED_M:
            break
        at += 1
    if at + 1 >= len(path):
        return Pursuit(0.0, 0.0, at)
    direction = float(path[at + 1, 4])
    others = np.flatnonzero(path[at + 1 :, 4] != direction)
    stretch = path[at + 1 : at + 1 + others[0] if len(others) else None]
    end_x, end_y, turned = stretch[-1, :3].tolist()
    beyond = end_x + direction * lookahead * math.cos(turned), end_y + direction * lookahead * math.sin(turned)
    points = np.vstack(((x, y), stretch[:, :2], beyond))
    along = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    dx, dy = np.interp(lookahead, along, points[:, 0]) - x, np.interp(lookahead, along, points[:, 1]) - y
    aside = math.cos(heading) * dy - math.sin(heading) * dx
    curvature = 2 * aside / max(dx * dx + dy * dy, 1e-4)
    return Pursuit(direction, float(min(max(curvature, -max_curvature), max_curvature)), at)


def tracking_speed(path: Floats, at: int, pose: Place, deceleration: float) -> float:
    """The speed between a point of the path and the next one: what can be braked to the speed there, m/s."""
    end = path[at + 1].tolist()
    braked = math.sqrt(end[5] ** 2 + 2 * deceleration * math.hypot(end[0] - pose[0], end[1] - pose[1]))
    return float(max(MIN_SPEED, min(max(float(path[at, 5]), end[5]), braked)))


@jit
def dijkstra(cost: Floats, goal: Floats, cell_m: float, start: int, beyond: float) -> Floats:
    """The least cost of a path from every cell to a goal, over eight neighbours.

    Args:
        cost: of a metre in each cell, `[rows, columns]`.
        goal: cost of ending in a cell; inf where no path may end.
        cell_m: side of a cell.
        start: index of the cell of the car; cells that cost more than `beyond` more than it stay inf.
    """
    rows, columns = cost.shape
    to_go, flat = goal.copy().ravel(), cost.ravel()
    heap = [(to_go[n], n) for n in range(rows * columns) if to_go[n] < np.inf]
    heapq.heapify(heap)
    enough = np.inf
    while len(heap) > 0:
        key, n = heapq.heappop(heap)
        if key > to_go[n]:
            continue
        if key > enough:
            break
        if n == start:
            enough = key + beyond
        row, column = n // columns, n % columns
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                m = r * columns + c
                length = cell_m * (math.sqrt(2.0) if r != row and c != column else 1.0)
                new = np.float32(key + length * 0.5 * (flat[n] + flat[m]))
                if new < to_go[m]:
                    to_go[m] = new
                    heapq.heappush(heap, (new, m))
    return np.where(to_go > enough, np.float32(np.inf), to_go).reshape(rows, columns)


class PathFrame(NamedTuple):
    left: float
    bottom: float
    cell: float


class Layers(NamedTuple):
    """What the lattice is planned on."""

    clearance: Floats  # distance to obstacles, m, `[rows, columns]`
    unknown: Floats  # 1 where nothing is known
    to_go: Floats  # of `dijkstra`, on coarser cells
    frame: PathFrame  # frame, coarse: of these grids
    coarse: PathFrame


@jit
def cell_value(grid: Floats, x: float, y: float, frame: PathFrame) -> float:
    """The value of the cell that holds a point; -1 outside."""
    row, column = math.floor((y - frame.bottom) / frame.cell), math.floor((x - frame.left) / frame.cell)
    inside = 0 <= row < grid.shape[0] and 0 <= column < grid.shape[1]
    return float(grid[row, column]) if inside else -1.0


@jit
def footprint_clearance(
    clearance: Floats, x: float, y: float, heading: float, centers: Floats, frame: PathFrame
) -> float:
    """The least clearance of the discs of the footprint."""
    cos, sin, least = math.cos(heading), math.sin(heading), 1e9
    for d in centers:
        least = min(least, cell_value(clearance, x + d * cos, y + d * sin, frame))
    return least


@jit
def lattice_astar(layers: Layers, start: Floats, curvatures: Floats, centers: Floats, min_clearance: float) -> Floats:
    """The best path for a car that cannot turn on the spot, on a lattice of arcs, over the horizon.

    Args:
        layers: the local map.
        start: x, y, heading, curvature and direction (+1 or -1) of the car.
        curvatures: of the arcs, 1/m; backward the straight and the tightest ones are driven.
        centers: of the discs of the footprint, along the body, m.
        min_clearance: of the discs, m.

    Returns:
        `[n, 5]`: x, y, heading, curvature driven to there, direction; the first row is the start. One row: no path.
    """
    frame, tightest, reach = layers.frame, np.abs(curvatures).max(), HORIZON_M + 1.0
    side = int(2 * reach / NODE_M) + 1
    visited = np.full((side, side, HEADINGS, 2), np.inf, np.float32)
    node, parent = np.empty((MAX_NODES, 5), np.float32), np.empty(MAX_NODES, np.int64)
    cost, driven = np.zeros(MAX_NODES, np.float32), np.zeros(MAX_NODES, np.float32)
    node[0], parent[0] = start, -1
    heap, made, end, best, best_value = [(np.float32(0.0), 0)], 1, -1, 0, np.inf
    first_clearance = footprint_clearance(layers.clearance, start[0], start[1], start[2], centers, frame)
    while len(heap) > 0 and made < MAX_NODES:
        _, n = heapq.heappop(heap)
        x, y, heading, curvature, direction = node[n]
        to_go = cell_value(layers.to_go, x, y, layers.coarse)
        if driven[n] > 0.35 and to_go >= 0 and to_go + 0.3 * cost[n] < best_value:
            best, best_value = n, to_go + 0.3 * cost[n]
        if to_go >= 0 and (driven[n] >= HORIZON_M or to_go < 0.15) and direction > 0:
            end = n
            break
        for backward in range(2):
            to = -1.0 if backward else 1.0
            for bend in curvatures:
                if backward and 0.0 < abs(bend) < 0.99 * tightest:
                    continue
                turned, new_heading = bend * STEP_M * to, heading + bend * STEP_M * to
                chord = STEP_M * (math.sin(turned / 2) / (turned / 2) if abs(turned) > 1e-6 else 1.0) * to
                half = STEP_M / 2 * to
                mx, my = x + half * math.cos(heading + turned / 4), y + half * math.sin(heading + turned / 4)
                nx, ny = x + chord * math.cos(heading + turned / 2), y + chord * math.sin(heading + turned / 2)
                clearance = min(
                    footprint_clearance(layers.clearance, mx, my, heading + turned / 2, centers, frame),
                    footprint_clearance(layers.clearance, nx, ny, new_heading, centers, frame),
                )
                leaves = driven[n] < EXIT_M and clearance >= first_clearance and clearance > 0
                if clearance < min_clearance and not leaves:
                    continue
                if backward and cell_value(layers.unknown, nx, ny, frame) > 0:
                    continue
                h = cell_value(layers.to_go, nx, ny, layers.coarse)
                if h < 0 or h == np.inf:
                    continue
                lack = (INFLATION_RADIUS_M - clearance) / (INFLATION_RADIUS_M - min_clearance)
                price = 1.0 + CURVATURE_COST * abs(bend) + CLEARANCE_COST * max(lack, 0.0)
                nose_x, nose_y = nx + NOSE_M * math.cos(new_heading), ny + NOSE_M * math.sin(new_heading)
                if cell_value(layers.unknown, nose_x, nose_y, frame) > 0:
                    price += UNKNOWN_COST
                if backward:
                    price *= REVERSE_COST_RATIO
                g = cost[n] + price * STEP_M + CURVATURE_CHANGE_COST * abs(bend - curvature)
                if to != direction:
                    g += DIRECTION_CHANGE_COST
                i, j = int((nx - start[0] + reach) / NODE_M), int((ny - start[1] + reach) / NODE_M)
                if not (0 <= i < side and 0 <= j < side):
                    continue
                t = math.floor((new_heading / (2 * math.pi)) * HEADINGS + 0.5) % HEADINGS
                if g >= visited[j, i, t, backward] - 1e-4 or made >= MAX_NODES:
                    continue
                visited[j, i, t, backward] = g
                node[made] = np.array((nx, ny, new_heading, bend, to), np.float32)
                parent[made], cost[made], driven[made] = n, g, driven[n] + STEP_M
                heapq.heappush(heap, (np.float32(g + h), made))
                made += 1
    n = end if end >= 0 else best
    chain = [n]
    while parent[n] >= 0:
        n = parent[n]
        chain.append(n)
    path: Floats = node[np.array(chain[::-1])]
    return path
