"""The controller that drives to goals and explores, by paths planned in its local grid."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ndtorch.navigation.body import braking_speed
from ndtorch.navigation.controllers.contract import (
    ARRIVED,
    CRUISE,
    REVERSE,
    STOPPED,
    SUPPRESSED,
    TURN,
    Command,
    Controller,
    Task,
    Trace,
)
from ndtorch.navigation.controllers.goal.params import GoalParams, with_memory
from ndtorch.navigation.controllers.goal.replanning import SPIN_BELOW, disc_cells, local_map, replan
from ndtorch.navigation.controllers.goal.tasks import (
    DONE,
    EXPLORE,
    MAX_POINTS,
    GoalState,
    is_fruitless,
    next_task,
    requested_tasks,
    with_pose,
)
from ndtorch.navigation.controllers.ranging._kernels import decide, limit, remember
from ndtorch.navigation.controllers.ranging.control import RangingControl, check_sizes, ranging_tables
from ndtorch.navigation.controllers.registry import register
from ndtorch.navigation.local_grid._kernels import Array, LocalGrid, move_grid
from ndtorch.navigation.local_grid.grid import cells_at, empty_grid
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.planning.costmap import clearance
from ndtorch.navigation.planning.path_tracking import pure_pursuit, seen_length, speed_towards
from ndtorch.navigation.planning.planner import goal_costs, plan
from ndtorch.navigation.proximity import ProximityScan
from ndtorch.navigation.stereo._kernels import Frames
from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch.navigation.stereo.rig import Rect, StereoRig


@register
class GoalControl(Controller):
    """Drives to a goal, explores, and returns home, by paths planned in its local grid.

    A few times a second a path is planned, ahead and backward, with arcs that the car can drive and its footprint
    (`planning`). In between it is tracked by pure pursuit. If the arcs of the reactive controller are blocked, the car
    stops, and after a while the reactive controller drives alone.

    Args:
        rig, dt, params: as `Controller`.

    Raises:
        InputError: numbers out of range, or inputs that do not belong together.
    """

    name, Params, modes = "goal", GoalParams, (CRUISE, TURN, SUPPRESSED, STOPPED, REVERSE, ARRIVED)
    has_goals = True
    backend, checks_near = "numba", True

    def __init__(self, rig: StereoRig, dt: float, params: GoalParams | None = None) -> None:
        super().__init__(rig, dt, params)
        p: GoalParams = self.params
        self.tasks = requested_tasks(p)
        self.explores = EXPLORE in self.tasks
        self.params = p = with_memory(p, p.exploration_memory_s) if self.explores else p
        self.reactive = RangingControl(rig, dt, p.reactive)
        tables = ranging_tables(rig, p.reactive, self.reactive.view, dt, p.miss_evidence)
        self.tables = tables._replace(grid=tables.grid._replace(beam_left=0.0))
        self.reactive.tables = self.tables
        self.dt = dt
        self.every = max(1, round(p.planner.plan_interval_s / dt))
        self.disc = disc_cells(p.visited_radius_m, p.visited_grid)

    @classmethod
    def params_for(cls, task: Task) -> GoalParams:
        """As `Controller.params_for`."""
        d = GoalParams()
        slow, unknown = (min(v, task.speed) for v in (d.tight_speed_m_per_s, d.unknown_speed_m_per_s))
        return GoalParams(
            task.goal,
            task.explore,
            task.return_home,
            speed_m_per_s=task.speed,
            tight_speed_m_per_s=slow,
            unknown_speed_m_per_s=unknown,
            reactive=replace(d.reactive, speed_m_per_s=min(d.reactive.speed_m_per_s, task.speed)),
        )

    @property
    def trace(self) -> Trace:
        """How the free ways to both sides compare."""
        return self.reactive.trace

    @property
    def fields(self) -> tuple[Rect, Rect]:
        """As of `RangingControl`."""
        return self.reactive.fields

    def see(self, frames: Frames, state: Any = None) -> tuple[Any, Any]:
        """As `RangingControl.see`."""
        return self.reactive.see(frames, state)

    def sides(self, seen: Any) -> Any:
        """As `RangingControl.sides`."""
        return self.reactive.sides(seen)

    def start(self, seen: Any, pose: Pose) -> GoalState:
        """The state of a car that stands at a pose, its home, and knows nothing."""
        none = np.zeros((0, 0), np.float32)
        visited = empty_grid(pose.x, pose.y, self.params.visited_grid) if self.explores else LocalGrid(none, none, none)
        return GoalState(
            reactive=self.reactive.start(seen, pose),
            visited=visited,
            home=(pose.x, pose.y),
            frame=(0.0, 0.0, 0.0),
            localised=0,
            task=self.tasks[0],
            path=np.zeros((MAX_POINTS, 6), np.float32),
            points=0,
            seen=0,
            at=0,
            due=0,
            direction=1.0,
            vetoed=0,
            reactive_steps=0,
            turn_to=math.inf,
            cost=0.0,
            fruitless_s=0.0,
            best_cost=math.inf,
            visited_before=0.0,
            no_progress_s=0.0,
            mode=SUPPRESSED,
            margin=math.inf,
        )

    def step(
        self, seen: Any, ranges: Ranges, pose: Pose, driven: Command, state: GoalState
    ) -> tuple[Command, GoalState]:
        """Remember what is seen, plan where it is time to, follow the path, and listen to the reactive controller."""
        check_sizes(state.reactive, self.reactive.sizes)
        t = self.tables
        here = (pose.x, pose.y, pose.heading)
        moved, noise = tuple(driven), state.reactive.floor.noise
        lengths, reactive = remember(seen, (ranges.x, ranges.y, ranges.valid), here, moved, state.reactive, t)
        speed, curvature, reactive = decide(lengths, here, moved, reactive, t)
        visited = self.visit(state.visited, here) if self.explores else state.visited
        state = state._replace(reactive=reactive, visited=visited)
        learning = reactive.floor.age < t.floor.learning
        command, state = self.drive(lengths, pose, Command(speed, curvature), state, learning)
        speed, curvature, reactive = limit(*map(float, command), state.reactive, lengths[0, 0], noise, t)
        if reactive.mode == STOPPED and state.reactive.mode != STOPPED and state.mode != ARRIVED:
            state = state._replace(mode=STOPPED)
        command, spin = Command(speed, curvature), self.reactive.spin
        if spin is not None and (learning or state.reactive_steps > 0):
            command, reactive = self.reactive.spun(command, reactive, pose)
        return command, state._replace(reactive=reactive)

    def on_near_obstacles(self, state: GoalState, pose: Pose, scan: ProximityScan) -> GoalState:
        """As `RangingControl.on_near_obstacles`."""
        return state._replace(reactive=self.reactive.on_near_obstacles(state.reactive, pose, scan))

    def on_pose(self, state: GoalState, pose: Pose, place: Pose) -> GoalState:
        """As `Controller.on_pose`: goals are where the localiser has them, not where dead reckoning has them."""
        return with_pose(state, pose, place)

    def on_goal(self, state: GoalState, goal: tuple[float, float]) -> GoalState:
        """As `Controller.on_goal`."""
        self.params = replace(self.params, goal=goal, explore=False, return_home=False)
        self.tasks = requested_tasks(self.params)
        state = state._replace(task=self.tasks[0], points=0, due=0, turn_to=math.inf, vetoed=0, mode=CRUISE)
        return state._replace(cost=0.0, fruitless_s=0.0)

    def can_resume(self, state: GoalState) -> bool:
        """As `RangingControl.can_resume`."""
        return self.reactive.can_resume(state.reactive)

    def status_message(self, state: GoalState) -> str | None:
        """As `RangingControl.status_message`."""
        return self.reactive.status_message(state.reactive)

    def warm_up(self) -> None:
        """Plan once, so that the searches are compiled."""
        state = self.start(None, Pose(0.0, 0.0, 0.0))
        replan(state, (0.0, 0.0, 0.0), self.params, self.every)
        # Where nothing is seen there is nowhere to go.
        grid, p = self.params.reactive.grid, self.params.planner
        around = local_map(state.reactive.grid.evidence, 0.0, 0.0, grid, 1.0, 1.0)
        ahead = goal_costs(around, (1.0, 0.0), p)
        plan(around, clearance(around.blocked, around.cell), ahead, (0.0, 0.0, 0.0), 0.0, 1.0, p)

    def visit(self, visited: LocalGrid, pose: tuple[float, float, float]) -> LocalGrid:
        """The cells around the car are visited."""
        p = self.params.visited_grid
        kept = move_grid(visited, pose, p.cell_m, 1.0)
        ahead, left = self.disc
        kept.evidence.reshape(-1)[cells_at(pose, ahead, left, p)] = 1.0
        return kept

    def drive(
        self, lengths: Array, pose: Pose, reaction: Command, state: GoalState, learning: bool
    ) -> tuple[Command, GoalState]:
        """The command that the plan wants.

        Args:
            lengths: of the reactive arcs, `[2, 8]`, m.
            pose, reaction: where the car is, and what the reactive controller would do.
            learning: the floor is not known yet.
        """
        here, second = (pose.x, pose.y, pose.heading), round(1 / self.dt)
        state = state._replace(margin=math.inf)
        if learning:
            return reaction, state
        state = next_task(state, here, self.tasks, self.params)
        if state.task == DONE:
            return Command(0.0, 0.0), state._replace(mode=ARRIVED)
        state = self.turned(state, here[2])
        if state.reactive_steps <= 0 and state.due <= 0 and math.isinf(state.turn_to):
            state = replan(state, here, self.params, self.every)
        nothing = is_fruitless(state)
        fruitless = state.fruitless_s + self.dt if nothing else 0.0
        state = state._replace(no_progress_s=state.no_progress_s + self.dt, fruitless_s=fruitless)
        if nothing and state.reactive_steps <= 0:
            # What was not seen yet is found by driving.
            state = state._replace(reactive_steps=second)
        if state.reactive_steps > 0:
            return reaction, state._replace(reactive_steps=state.reactive_steps - 1, due=0, mode=state.reactive.mode)
        if not math.isinf(state.turn_to):
            return self.turn(pose, state)
        path = state.path[: state.points]
        p = self.params
        aim = pure_pursuit(path, state.at, here, p.lookahead_m, p.max_curvature_per_m)
        if aim.direction == 0:
            # The path has ended, or there is none: plan again at the next frame, and let the other drive if that fails.
            tired = state.vetoed >= 2 * self.every
            vetoed, lost = (0, second) if tired else (state.vetoed + 1, 0)
            return Command(0.0, 0.0), state._replace(due=0, vetoed=vetoed, reactive_steps=lost, mode=TURN)
        wanted = speed_towards(path, aim.at, here, p.deceleration_m_per_s2)
        free = self.free_ahead(lengths, aim.direction, aim.curvature)
        brake, delay = p.deceleration_m_per_s2, p.reaction_s
        safe = braking_speed(free, brake, delay)
        seen = seen_length(path, aim.at, state.seen, here)
        speed = min(wanted, safe, max(braking_speed(seen, brake, delay), p.unknown_speed_m_per_s))
        stopping = speed * delay + speed * speed / (2 * brake)
        blocked = safe < 0.1
        refused = state.vetoed + 1 if blocked else 0
        weary = refused >= second
        state = state._replace(
            at=aim.at,
            due=0 if blocked else state.due - 1,
            direction=aim.direction,
            vetoed=0 if weary else refused,
            reactive_steps=second if weary else 0,
            # What the other was about does not matter while it does not drive.
            reactive=state.reactive._replace(mode=CRUISE, age=0, has_reversed=0),
            mode=CRUISE if aim.direction > 0 else REVERSE,
            margin=min(free, seen) - stopping if aim.direction > 0 and not blocked else math.inf,
        )
        return Command(0.0 if blocked else speed * aim.direction, aim.curvature), state

    def turned(self, state: GoalState, heading: float) -> GoalState:
        """The state with a turn on the spot ended where it has reached its heading."""
        if math.isinf(state.turn_to):
            return state
        off = abs(math.remainder(state.turn_to - heading, math.tau))
        return state._replace(turn_to=math.inf, due=0) if off < SPIN_BELOW else state

    def turn(self, pose: Pose, state: GoalState) -> tuple[Command, GoalState]:
        """Turn on the spot towards the path; where there is no room, the reactive controller drives for a second."""
        assert self.reactive.spin is not None
        side = math.remainder(state.turn_to - pose.heading, math.tau)
        command = self.reactive.turn_on_spot(state.reactive, pose, side)
        kept = state.reactive._replace(mode=CRUISE, age=0, has_reversed=0)
        if command is None:
            state = state._replace(turn_to=math.inf, due=0, reactive_steps=round(1 / self.dt))
            return Command(0.0, 0.0), state._replace(reactive=kept, mode=TURN)
        return command, state._replace(reactive=kept, mode=TURN)

    def free_ahead(self, lengths: Array, direction: float, curvature: float) -> float:
        """How far the reactive controller sees room on the arcs nearest to the one that is wanted, m."""
        arcs = self.tables.arcs
        bends, ways = arcs.curvature.tolist(), arcs.forward.tolist()
        free: list[float] = lengths[0].tolist()
        side = sorted(
            (abs(bend - curvature), length)
            for bend, way, length in zip(bends, ways, free, strict=True)
            if way == direction
        )
        return float(max(length for _, length in side[:2]))

    def mode(self, state: GoalState) -> int:
        """What the car is doing; `TURN` is the reactive controller at the wheel, `ARRIVED` nothing left to do."""
        return state.mode

    def difference(self, state: GoalState) -> float:
        """Length of the free arcs on the left minus the right, m."""
        return state.reactive.difference
