"""The controller that is told where to go."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

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
from ndtorch.navigation.controllers.goal.errands import DONE, EXPLORE, asked, finds_nothing, next_errand, told_place
from ndtorch.navigation.controllers.goal.memory import disc_cells, surroundings
from ndtorch.navigation.controllers.goal.params import GoalParams, remembering
from ndtorch.navigation.controllers.goal.replanning import replan
from ndtorch.navigation.controllers.goal.state import LONGEST, GoalState, put_together, take
from ndtorch.navigation.controllers.ranging.caution import woken
from ndtorch.navigation.controllers.ranging.control import RangingControl
from ndtorch.navigation.controllers.ranging.decision import decide
from ndtorch.navigation.controllers.ranging.patch import Patch, cell_numbers, empty_patch, move_patch
from ndtorch.navigation.controllers.registry import register
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.planning.costmap import clearance
from ndtorch.navigation.planning.path_tracking import pure_pursuit, speed_towards
from ndtorch.navigation.planning.planner import goal_costs, plan
from ndtorch.navigation.proximity.stereo_match import Obstacles
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.rig import StereoRig

RAY = 24
"""Places on the line of sight before a range that count as seen free."""


@register
class GoalControl(Controller):
    """Drives to a place, explores, and comes back, by ways planned on what it has seen.

    What was seen free or blocked stays in a square of cells around the car, the memory of `RangingControl` with
    other numbers. A few times a second the way to the goal is planned there, ahead and backward, with arcs that the
    car can drive and an outline that fits (`planning`). In between it is followed. Where the arcs of the
    reactive controller are blocked it stops the car, and after a while drives by itself.

    A batch is planned one car after the other.

    Args:
        rig, dt, params: as `Controller`.

    Raises:
        InputError: numbers out of range, or inputs that do not belong together.
    """

    name, Params, modes = "goal", GoalParams, (CRUISE, TURN, SUPPRESSED, STOPPED, REVERSE, ARRIVED)
    has_goals = True
    looks_near = True

    def __init__(self, rig: StereoRig, dt: float, params: GoalParams | None = None) -> None:
        super().__init__(rig, dt, params)
        p: GoalParams = self.params
        self.errands = asked(p)
        self.explores = EXPLORE in self.errands
        self.params = p = remembering(p, p.lifetime) if self.explores else p
        self.reactive = RangingControl(rig, dt, p.reactive)
        self.look = self.reactive.look
        self.dt, self.forward_of_axis = dt, rig.forward
        self.every = max(1, round(p.planner.plan_interval_s / dt))
        self.line = torch.linspace(0.15, 0.88, RAY)
        self.disc = disc_cells(p.passed, p.places)
        self.numbers = torch.arange(p.places.size, dtype=torch.get_default_dtype())

    @classmethod
    def params_for(cls, task: Task) -> GoalParams:
        """As `Controller.params_for`."""
        d = GoalParams()
        slow, creep = min(d.slow, task.cruise), min(d.creep, task.cruise)
        r = d.reactive
        tight, back = min(r.tight_speed, 0.8 * task.cruise), min(r.reverse_speed, task.cruise)
        reactive = replace(r, speed=min(r.speed, task.cruise), tight_speed=tight, reverse_speed=back)
        return GoalParams(
            task.to, task.explore, task.back, speed=task.cruise, slow=slow, creep=creep, reactive=reactive
        )

    @property
    def trace(self) -> Trace:
        """How the free ways to both sides compare."""
        return self.reactive.trace

    def sides(self, seen: Tensor) -> Tensor:
        """As `RangingControl.sides`."""
        return self.reactive.sides(seen)

    def start(self, seen: Tensor, pose: Pose) -> GoalState:
        """The state of a car that stands at a pose, its home, and knows nothing."""
        blank = torch.zeros_like(pose.x)
        none = blank.new_zeros(*blank.shape, 0)
        visited = empty_patch(pose, self.params.places) if self.explores else Patch(none, none, none)
        return GoalState(
            self.reactive.start(seen, pose),
            visited,
            torch.stack((pose.x, pose.y), -1),
            blank.new_zeros(*blank.shape, 3),
            blank,
            blank + self.errands[0],
            blank.new_zeros(*blank.shape, LONGEST, 6),
            blank,
            blank,
            blank,
            blank + 1,
            blank,
            blank,
            blank,
            blank,
            blank + math.inf,
            blank,
            blank,
            blank + SUPPRESSED,
        )

    def step(
        self, seen: Tensor, ranges: Ranges, pose: Pose, driven: Command, state: GoalState
    ) -> tuple[Command, GoalState]:
        """Remember what is seen, plan where it is time to, follow the way, and listen to the reactive controller."""
        woke = woken(state.reactive.mode, state.reactive.floor, self.reactive.floor)
        state = state._replace(reactive=state.reactive._replace(mode=woke))
        return self.caution(*self.steer(seen, ranges, pose, driven, state), pose, state.reactive.floor.noise)

    def steer(
        self, seen: Tensor, ranges: Ranges, pose: Pose, driven: Command, state: GoalState
    ) -> tuple[Command, GoalState]:
        """`step` without caution."""
        c = self.reactive.constants
        before = state.reactive
        lengths, floor, patch = self.reactive.sense(seen, ranges, pose, driven, before, self.rays(ranges))
        reaction, reactive = decide(lengths, driven, floor, patch, before, c, self.reactive.floor, pose)
        learning = floor.age < self.reactive.floor.learning
        visited = self.visit(state.visited, pose) if self.explores else state.visited
        state = state._replace(reactive=reactive, visited=visited)
        if pose.x.ndim == 0:
            return self.drive_one(lengths, pose, reaction, state, bool(learning))
        made = []
        batch, flat = pose.x.shape, pose.x.numel()
        for n in range(flat):
            one = take(state, n, len(batch))
            here = Pose(*(part.reshape(-1)[n] for part in pose))
            react = Command(*(part.reshape(-1)[n] for part in reaction))
            free = lengths.reshape(flat, *lengths.shape[len(batch) :])[n]
            made.append(self.drive_one(free, here, react, one, bool(learning.reshape(-1)[n])))
        commands, states = zip(*made, strict=True)
        return put_together(list(commands), batch), put_together(list(states), batch)

    def caution(
        self, command: Command, state: GoalState, pose: Pose, noise: Tensor | None = None
    ) -> tuple[Command, GoalState]:
        """As `RangingControl.caution`."""
        command, reactive = self.reactive.caution(command, state.reactive, pose, noise)
        if reactive is state.reactive:
            return command, state
        stands = (reactive.mode == STOPPED) & (state.reactive.mode != STOPPED) & (state.mode != ARRIVED)
        mode = torch.where(stands, reactive.mode, state.mode)
        return command, state._replace(reactive=reactive, mode=mode)

    def told_near(
        self, state: GoalState, pose: Pose, things: Obstacles, across: Obstacles, floor_seen: bool
    ) -> GoalState:
        """As `RangingControl.told_near`."""
        return state._replace(reactive=self.reactive.told_near(state.reactive, pose, things, across, floor_seen))

    def told_place(self, state: GoalState, pose: Pose, place: Pose | None) -> GoalState:
        """As `Controller.told_place`: goals are where the car is told that it is, not where dead reckoning has them."""
        return told_place(state, pose, place)

    def settled(self, state: GoalState) -> bool:
        """As `RangingControl.settled`."""
        return self.reactive.settled(state.reactive)

    def trouble(self, state: GoalState) -> str | None:
        """As `RangingControl.trouble`."""
        return self.reactive.trouble(state.reactive)

    def warm_up(self) -> None:
        """Plan once, so that the searches are compiled."""
        origin = torch.zeros(())
        state = self.start(torch.zeros_like(self.look.view.x), Pose(origin, origin, origin))  # type: ignore[union-attr, arg-type]
        replan(state, (0.0, 0.0, 0.0), self.params, self.every)
        # Where nothing is seen there is nowhere to go.
        patch, p = self.params.reactive.patch, self.params.planner
        around = surroundings(state.reactive.patch.evidence, 0.0, 0.0, patch, 1.0, 1.0)
        ahead = goal_costs(around, (1.0, 0.0), p)
        plan(around, clearance(around.blocked, around.cell), ahead, (0.0, 0.0, 0.0), 0.0, 1.0, p)

    def rays(self, ranges: Ranges) -> tuple[Tensor, Tensor]:
        """Places on the lines of sight, and what is taken from each."""
        ahead, aside = ranges.x - self.forward_of_axis, ranges.y
        x = self.forward_of_axis + ahead.unsqueeze(-1) * self.line
        y = aside.unsqueeze(-1) * self.line
        # Several places of a line may lie in one cell: together they take `miss`.
        apart = torch.hypot(ahead, aside) * float(self.line[1] - self.line[0]) / self.params.reactive.patch.cell
        weight = (-self.params.miss * apart.clamp(max=1.0) * ranges.valid).unsqueeze(-1).expand(x.shape)
        return torch.stack((x.flatten(-2), y.flatten(-2)), -2), weight.flatten(-2)

    def visit(self, visited: Patch, pose: Pose) -> Patch:
        """The cells around the car are visited."""
        p = self.params.places
        kept = move_patch(visited, pose, self.numbers, torch.ones_like(pose.x), p)
        disc = self.disc.to(pose.x.dtype)
        number = cell_numbers(disc.expand(*pose.x.shape, *disc.shape), pose, p)
        return kept._replace(evidence=kept.evidence.scatter(-1, number, 1.0))

    def drive_one(
        self, lengths: Tensor, pose: Pose, reaction: Command, state: GoalState, learning: bool
    ) -> tuple[Command, GoalState]:
        """The command of one car.

        Args:
            lengths: of the reactive arcs, `[2, 8]`, m.
            pose, reaction: where the car is, and what the reactive controller would do, without dimensions.
            learning: the floor is not known yet.
        """
        here = (float(pose.x), float(pose.y), float(pose.heading))
        if learning:
            return reaction, state
        state = next_errand(state, here, self.errands, self.params)
        if int(state.errand) == DONE:
            still = torch.zeros_like(pose.x)
            return Command(still, still), state._replace(mode=still + ARRIVED)
        if int(state.told) < 0:
            # A place in a known map means nothing before the car has found itself there.
            return reaction, state._replace(due=state.due * 0, mode=state.reactive.mode)
        if int(state.lost) <= 0 and int(state.due) <= 0:
            state = replan(state, here, self.params, self.every)
        state = state._replace(tried=state.tried + self.dt)
        nothing = finds_nothing(state)
        state = state._replace(fruitless=state.fruitless + self.dt if nothing else state.fruitless * 0)
        if nothing and int(state.lost) <= 0:
            # What was not seen yet is found by driving.
            state = state._replace(lost=torch.full_like(state.lost, 1 / self.dt))
        if int(state.lost) > 0:
            state = state._replace(lost=state.lost - 1, due=state.due * 0, mode=state.reactive.mode)
            return reaction, state
        way = state.way[: int(state.places)].numpy()
        p = self.params
        aim = pure_pursuit(way, int(state.at), here, p.ahead, p.tightest)
        if aim.direction == 0:
            # The way has ended, or there is none: plan again at the next frame, and let the other drive if that fails.
            tired = int(state.vetoed) >= 2 * self.every
            lost_for = torch.full_like(state.lost, 1 / self.dt if tired else 0.0)
            vetoed = state.vetoed * 0 if tired else state.vetoed + 1
            still = torch.zeros_like(pose.x)
            return Command(still, still), state._replace(due=still, vetoed=vetoed, lost=lost_for, mode=still + TURN)
        wanted = speed_towards(way, aim.at, here, p.braking)
        free = self.free_ahead(lengths, aim.direction, aim.curvature)
        safe = math.sqrt(2 * p.braking * max(0.0, free - p.lag))
        speed = min(wanted, safe)
        blocked = safe < 0.1
        refused = int(state.vetoed) + 1 if blocked else 0
        new = torch.full_like
        weary = refused >= round(1.0 / self.dt)
        state = state._replace(
            at=new(state.at, aim.at),
            due=state.due * 0 if blocked else state.due - 1,
            direction=new(state.direction, aim.direction),
            vetoed=new(state.vetoed, 0.0 if weary else refused),
            lost=new(state.lost, 1 / self.dt if weary else 0.0),
            # What the other was about does not matter while it does not drive.
            reactive=state.reactive._replace(mode=new(state.mode, CRUISE), age=state.mode * 0, bold=state.mode * 0),
            mode=new(state.mode, CRUISE if aim.direction > 0 else REVERSE),
        )
        if blocked:
            speed = 0.0
        return Command(new(pose.x, speed * aim.direction), new(pose.x, aim.curvature)), state

    def free_ahead(self, lengths: Tensor, direction: float, curvature: float) -> float:
        """How far the reactive controller sees room on the arcs nearest to the one that is wanted, m."""
        arcs = self.reactive.arcs
        bends, ways = arcs.curvature.tolist(), arcs.forward.tolist()
        free: list[float] = lengths[0].tolist()
        side = sorted(
            (abs(bend - curvature), length)
            for bend, way, length in zip(bends, ways, free, strict=True)
            if way == direction
        )
        return float(max(length for _, length in side[:2]))

    def mode(self, state: GoalState) -> Tensor:
        """What the car is doing; `TURN` is the reactive controller at the wheel, `ARRIVED` nothing left to do."""
        return state.mode

    def difference(self, state: GoalState) -> Tensor:
        """Length of the free arcs on the left minus the right, m."""
        return state.reactive.difference
