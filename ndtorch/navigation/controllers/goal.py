"""The controller that drives to goals and explores, by paths planned in its local grid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ndtorch.navigation import local_grid, planning
from ndtorch.navigation.body import braking_speed
from ndtorch.navigation.controllers.contract import (
    ARRIVED,
    CRUISE,
    REVERSE,
    STOPPED,
    SUPPRESSED,
    TURN,
    Command,
    register,
)
from ndtorch.navigation.controllers.ranging._kernels import (
    BLOCKED,
    FloorState,
    RangingState,
    decide,
    limit,
    remember,
)
from ndtorch.navigation.controllers.ranging.control import RangingControl, RangingParams
from ndtorch.navigation.local_grid import Array, LocalGrid, LocalGridParams, Place
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.planning import LocalMap, PlannerParams
from ndtorch.navigation.proximity import ProximityScan
from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch.navigation.stereo.rig import StereoRig

GOAL, EXPLORE, HOME, DONE = 0, 1, 2, 3  # tasks
MAX_POINTS = 40  # points of a path that are kept: more than its horizon has arcs
PLAN_INTERVAL_S = 0.2  # a path is planned so often
FREE_RATIO = 0.1  # cells with less evidence than minus this ratio of a blocked cell's are free
CELL_M = 0.05  # side of a cell of the local grid

REACTION_S = 0.2
"""The car brakes this long after an obstacle came into view: two frames of ranges, a step, and the body's reaction."""

MIN_SAFE_SPEED = 0.1  # m/s: where the car could only drive more slowly, the path is blocked

STUCK_S, REACTIVE_S = 1.0, 1.0
"""A car that has stood without a free path for the first time is driven by the reactive controller for the second."""

EXPLORED_S = 10.0  # exploration ends when no path to unvisited floor was found for this long
VISITED_M = 0.9  # exploring, everything within this distance of the car is visited
CURVATURE_RATIO = 1.075  # largest commanded curvature over that of the tightest planned arc

SPIN_LOOK_M, SPIN_ABOVE, SPIN_BELOW = 0.6, math.radians(60), math.radians(15)
"""A differential drive turns on the spot where the point so far down the costs to the goal is farther off its heading
than the first angle, until it is nearer than the second."""


@dataclass(frozen=True)
class GoalParams(PlannerParams):
    """Parameters of the goal controller, beside those of `PlannerParams`.

    Args:
        goal: Place to drive to, x and y in m in the frame of the pose; None for no goal.
        explore: The car then drives wherever it was not yet; it does so without any other task, too.
        return_home: The car then drives back to where it began.
        goal_tolerance_m: Distance within which a goal is reached.
        lookahead_m: Distance along the path at which pure pursuit aims.
        memory_s: Time in which evidence of obstacles and floor falls to 1/e.
        map_cells: Number of cells of 5 cm along each side of the local grid, a power of two.
    """

    goal: tuple[float, float] | None = None
    explore: bool = False
    return_home: bool = False
    goal_tolerance_m: float = 0.3
    lookahead_m: float = 0.3
    memory_s: float = 300.0
    map_cells: int = 512


class GoalState(NamedTuple):
    """State of `GoalControl`."""

    reactive: RangingState  # state of the reactive controller, with its local grid
    visited: LocalGrid  # 1 in visited cells; no cells where the controller does not explore
    task: int  # `GOAL`, `EXPLORE`, `HOME` or `DONE`
    goal: tuple[float, float]  # goal, home: x, y, m, in the frame of the map
    home: tuple[float, float]
    explores: bool  # explores, returns: whether exploration and the way home follow
    returns: bool
    frame: Place  # pose of that frame in the frame of dead reckoning
    path: Array  # `[MAX_POINTS, 6]`, see `PlannedPath`
    points: int = 0  # points, at: number of its points, and index of the one reached
    at: int = 0
    due: int = 0  # time steps until the next plan
    direction: float = 1.0  # +1 ahead, -1 backward
    stuck: int = 0  # consecutive time steps without a free path
    idle: int = 0  # time steps since a path to the end of the task was found
    reactive_steps: int = 0  # time steps for which the reactive controller drives alone
    # heading to which a differential drive turns on the spot, radians; inf while it does not
    turn_to: float = math.inf
    mode: int = SUPPRESSED  # what the car is doing

    @property
    def floor(self) -> FloorState:
        return self.reactive.floor

    @property
    def difference(self) -> float:
        return self.reactive.difference


@register
class GoalControl(RangingControl):
    """Drives to a goal, explores, and returns home, by paths planned in its local grid.

    A few times a second a path is planned, ahead and backward, with arcs that the car can drive and its footprint.
    In between it is tracked by pure pursuit. If the arcs of the reactive controller are blocked, the car
    stops, and after a second the reactive controller drives alone for another one.
    """

    name, Params, modes = "goal", GoalParams, (CRUISE, TURN, SUPPRESSED, STOPPED, REVERSE, ARRIVED)
    has_goals, seen_through = True, 0.15

    def __init__(self, rig: StereoRig, dt: float, params: GoalParams | None = None) -> None:
        super().__init__(rig, dt, params)
        p: GoalParams = self.params
        self.dt, self.grid, self.explores = dt, self.reactive.grid, p.explore or not (p.goal or p.return_home)
        line = np.arange(-VISITED_M, VISITED_M, CELL_M, dtype=np.float32)
        ahead, left = (part.ravel() for part in np.meshgrid(line, line))
        inside = np.hypot(ahead, left) <= VISITED_M
        self.disc = ahead[inside], left[inside]

    def reactive_params(self) -> RangingParams:
        """A large memory that lasts, and less room."""
        p: GoalParams = self.params
        return RangingParams(
            min(RangingParams.speed_m_per_s, p.speed_m_per_s),
            safety_margin_m=0.03,
            min_free_m=0.15,
            overhangs=False,
            body=p.body,
            grid=LocalGridParams(CELL_M, p.map_cells, p.memory_s),
        )

    @classmethod
    def params_for(cls, speed: float, **tasks: Any) -> GoalParams:
        names = "speed_m_per_s", "tight_speed_m_per_s", "unknown_speed_m_per_s"
        speeds = {name: min(speed, getattr(GoalParams, name)) for name in names} | {names[0]: speed}
        return GoalParams(**speeds, **tasks)

    def start(self, seen: Any, pose: Pose) -> GoalState:
        p, none = self.params, np.zeros((0, 0), np.float32)
        state = GoalState(
            reactive=super().start(seen, pose),
            visited=local_grid.empty_grid(pose.x, pose.y, self.grid) if self.explores else LocalGrid(none, none, none),
            task=GOAL,
            goal=(math.inf, math.inf) if p.goal is None else (float(p.goal[0]), float(p.goal[1])),
            home=(pose.x, pose.y),
            explores=self.explores,
            returns=p.return_home,
            frame=(0.0, 0.0, 0.0),
            path=np.zeros((MAX_POINTS, 6), np.float32),
        )
        return state if p.goal is not None else next_task(state)

    def step(
        self, seen: Any, ranges: Ranges, pose: Pose, driven: Command, state: GoalState
    ) -> tuple[Command, GoalState]:
        self.check_sizes(state.reactive)
        t, here, moved, noise = self.tables, tuple(pose), tuple(driven), state.reactive.floor.noise
        lengths, reactive = remember(seen, (ranges.x, ranges.y, ranges.valid), here, moved, state.reactive, t)
        speed, curvature, reactive = decide(lengths, here, moved, reactive, t)
        state = state._replace(reactive=reactive)
        if self.explores:
            visited = local_grid.move_grid(state.visited, here, CELL_M, 1.0)
            visited.evidence.reshape(-1)[local_grid.cell_index(*self.disc, here, CELL_M, self.grid.size_cells)] = 1.0
            state = state._replace(visited=visited)
        learning = reactive.floor.age < t.numbers[0]["learning"]
        reacts = learning or state.reactive_steps > 0
        command = Command(speed, curvature)
        if not learning:
            command, state = self.drive(lengths, pose, command, state)
        speed, curvature, reactive = limit(*map(float, command), state.reactive, lengths[0, 0], noise, t)
        if reactive.mode == STOPPED and state.reactive.mode != STOPPED and state.mode != ARRIVED:
            state = state._replace(mode=STOPPED)
        command = Command(speed, curvature)
        if self.spin is not None and reacts:
            command, reactive = self.spun(command, reactive, pose)
        return command, state._replace(reactive=reactive)

    def drive(self, lengths: Array, pose: Pose, reaction: Command, state: GoalState) -> tuple[Command, GoalState]:
        """The command that the plan wants; `lengths` are those of the reactive arcs, `[2, A]`, m."""
        here: Place = (pose.x, pose.y, pose.heading)
        goal, idle = self.task_goal(state), state.idle + 1
        arrived = goal is not None and math.dist(goal, here[:2]) <= self.params.goal_tolerance_m
        if arrived or (state.task == EXPLORE and idle > EXPLORED_S / self.dt):
            state, idle = next_task(state), 0
        if state.task == DONE:
            return Command(0.0, 0.0), state._replace(mode=ARRIVED)
        if state.reactive_steps > 0:
            left = state.reactive_steps - 1
            return reaction, state._replace(reactive_steps=left, idle=idle, due=0, mode=state.reactive.mode)
        state = state._replace(idle=idle)
        if math.isfinite(state.turn_to) and abs(math.remainder(state.turn_to - here[2], math.tau)) < SPIN_BELOW:
            state = state._replace(turn_to=math.inf, due=0)
        if state.due <= 0 and math.isinf(state.turn_to):
            state = self.replan(state, here)
        if math.isinf(state.turn_to):
            command, state = self.follow(lengths, here, state)
        else:
            turn = self.turn_on_spot(state.reactive, pose, math.remainder(state.turn_to - here[2], math.tau))
            state = state._replace(stuck=0 if turn else state.stuck + 1, mode=TURN)
            command = turn or Command(0.0, 0.0)
        # What the reactive controller was about does not matter while it does not drive.
        state = state._replace(reactive=state.reactive._replace(mode=CRUISE, age=0, has_reversed=0))
        if state.stuck * self.dt >= STUCK_S:
            state = state._replace(stuck=0, turn_to=math.inf, reactive_steps=round(REACTIVE_S / self.dt))
        return command, state

    def follow(self, lengths: Array, here: Place, state: GoalState) -> tuple[Command, GoalState]:
        """Track the path; the car stands where there is none or the reactive controller sees no room on it."""
        p, path = self.params, state.path[: state.points]
        most = CURVATURE_RATIO * p.max_curvature_per_m
        aim = planning.pure_pursuit(path, state.at, here, p.lookahead_m, most)
        if aim.direction == 0:
            return Command(0.0, 0.0), state._replace(due=0, stuck=state.stuck + 1, mode=TURN)
        # Room on the two arcs of the reactive controller that are nearest to the one that is wanted
        arcs = self.tables.arcs
        off = np.where(arcs.forward == aim.direction, np.abs(arcs.curvature - aim.curvature), np.inf)
        safe = braking_speed(float(lengths[0, np.argsort(off)[:2]].max()), p.deceleration_m_per_s2, REACTION_S)
        blocked = safe < MIN_SAFE_SPEED
        speed = 0.0 if blocked else min(safe, planning.tracking_speed(path, aim.at, here, p.deceleration_m_per_s2))
        return Command(speed * aim.direction, aim.curvature), state._replace(
            at=aim.at,
            due=0 if blocked else state.due - 1,
            direction=aim.direction,
            stuck=state.stuck + 1 if blocked else 0,
            mode=CRUISE if aim.direction > 0 else REVERSE,
        )

    def replan(self, state: GoalState, here: Place) -> GoalState:
        p, goal, evidence = self.params, self.task_goal(state), state.reactive.grid.evidence
        cells, left, bottom = local_grid.unrolled(evidence, here[0], here[1], self.grid)
        around = LocalMap(cells >= BLOCKED, cells < -FREE_RATIO * BLOCKED, left, bottom, CELL_M)
        if goal is None:
            visited, _, _ = local_grid.unrolled(state.visited.evidence, here[0], here[1], self.grid)
            goals = planning.unvisited_costs(p, around, visited > 0)
        else:
            goals = planning.goal_costs(around, goal)
        at = min(state.at + 1, max(0, state.points - 1))
        curvature = float(state.path[at, 3]) if state.points else 0.0
        made = planning.plan(p, around, goals, here, curvature, state.direction, exploring=goal is None)
        points, turn_to = min(len(made.path), MAX_POINTS), math.inf
        path = np.zeros((MAX_POINTS, 6), np.float32)
        path[:points] = made.path[:points]
        if p.body.spins and math.isfinite(made.cost):
            heading = path_heading(made.to_go, around, here)
            turn_to = heading if abs(math.remainder(heading - here[2], math.tau)) > SPIN_ABOVE else math.inf
        return state._replace(
            path=path,
            points=points if points > 1 else 0,
            at=0,
            due=max(1, round(PLAN_INTERVAL_S / self.dt)),
            idle=0 if math.isfinite(made.cost) else state.idle,
            turn_to=turn_to,
        )

    def task_goal(self, state: GoalState) -> tuple[float, float] | None:
        """The goal of the task in the frame of dead reckoning; None when exploring."""
        if state.task in (EXPLORE, DONE):
            return None
        x, y = state.goal if state.task == GOAL else state.home
        return to_frame(state.frame, x, y)

    def on_pose(self, state: GoalState, pose: Pose, place: Pose) -> GoalState:
        """As `Controller.on_pose`: goals are in the frame of the map, paths in that of dead reckoning."""
        turned = pose.heading - place.heading
        ahead, aside = to_frame((0.0, 0.0, turned), place.x, place.y)
        return state._replace(frame=(pose.x - ahead, pose.y - aside, turned))

    def on_goal(self, state: GoalState, goal: tuple[float, float]) -> GoalState:
        x, y = map(float, goal)
        state = state._replace(task=GOAL, goal=(x, y), explores=False, returns=False, mode=CRUISE)
        return state._replace(points=0, due=0, stuck=0, idle=0, turn_to=math.inf)

    def on_near_obstacles(self, state: GoalState, pose: Pose, scan: ProximityScan) -> GoalState:
        return state._replace(reactive=super().on_near_obstacles(state.reactive, pose, scan))

    def warm_up(self) -> None:
        super().warm_up()
        state = self.start(None, Pose(0.0, 0.0, 0.0))._replace(task=GOAL, goal=(1.0, 0.0))
        self.replan(state, (0.0, 0.0, 0.0))


def next_task(state: GoalState) -> GoalState:
    tasks = (GOAL, EXPLORE if state.explores else DONE, HOME if state.returns else DONE, DONE)
    task = next((task for task in tasks[state.task + 1 :] if task != DONE), DONE)
    return state._replace(task=task, points=0, due=0, idle=0, turn_to=math.inf)


def to_frame(frame: Place, x: float, y: float) -> tuple[float, float]:
    """A point of a frame in the frame in which that one is given, m."""
    left, bottom, turned = frame
    cos, sin = math.cos(turned), math.sin(turned)
    return left + cos * x - sin * y, bottom + sin * x + cos * y


def path_heading(to_go: Array, around: LocalMap, here: Place) -> float:
    """Heading from here to the point `SPIN_LOOK_M` down the costs of `dijkstra`, radians; NaN where they end here."""
    start = row, column = tuple(int(n) for n in around.cells_of(here[0], here[1], planning.COARSE))
    for _ in range(round(SPIN_LOOK_M / (around.cell * planning.COARSE))):
        top, left = max(row - 1, 0), max(column - 1, 0)
        beside = to_go[top : row + 2, left : column + 2]
        down, aside = divmod(int(beside.argmin()), beside.shape[1])
        row, column = top + down, left + aside
    moved = row - start[0], column - start[1]
    return math.atan2(*moved) if any(moved) else math.nan
