"""The controller that goes beyond the paper: it drives where it has seen floor."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ndtorch.errors import InputError
from ndtorch.navigation.body import CRUISE_SPEED, SPOT_RADIUS
from ndtorch.navigation.controllers.contract import (
    CRUISE,
    REVERSE,
    STOPPED,
    SUPPRESSED,
    TURN,
    Command,
    Controller,
    SensingRequest,
    Trace,
)
from ndtorch.navigation.controllers.ranging._kernels import (
    AHEAD,
    START_FREE_M,
    TIGHT_LEFT,
    TIGHT_RIGHT,
    WIDE_LEFT,
    WIDE_RIGHT,
    RangingState,
    RangingTables,
    ranging_step,
)
from ndtorch.navigation.controllers.ranging.floor import (
    FULL_RATIO,
    MIN_NOISE,
    FloorState,
    FloorView,
    floor_tables,
    floor_view,
    known_ratio,
    see_floor,
)
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.controllers.registry import register
from ndtorch.navigation.local_grid._kernels import (
    LINE_FROM,
    LINE_PLACES,
    LINE_TO,
    GridNumbers,
    Primitives,
    add_ranges,
    cell_index,
    costs,
    free_distances,
)
from ndtorch.navigation.local_grid.grid import empty_grid, empty_path, mark_obstacles, mark_stop, motion_primitives
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity import Obstacles, ProximityScan
from ndtorch.navigation.stereo._kernels import Array, Frames, packed
from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch.navigation.stereo.strips import at_rects, check_peak, checked
from ndtorch.vision.temporal import smoothing_factor

TAU_HIGH = 0.005
"""Time constant of the high-pass, s, as [A] has it."""

RANGE_EVIDENCE, SEARCH_EVIDENCE, MISS_EVIDENCE, BLOCKED = 1.0, 2.0, 0.15, 1.9
"""A cell with a range in it becomes blocked by the first, with one of a search by the second; a range takes the third
from each raised cell on its line of sight; a cell is blocked from the fourth on, and known floor below -0.19."""

SEARCH_INTERVAL_S, BOXED_IN_S = 0.17, 1.0
"""The right row is searched so often for what stands; a car that is boxed in forgets with the second time constant."""

TURN_RATE = 0.8
"""Radians a second of a turn on the spot, as in a tight turn of the car of [A]."""

STEPS, MIN_STEPS = 9, 3
"""Steps of 20 degrees of half a turn on the spot that are looked at, and fewest of them for a turn to begin."""


@register
class RangingControl(Controller):
    """Drives where floor was seen, and away from where it ends or a range says that something is.

    What is seen are the cells of `see_floor`, `[4, bands, blocks]`. The state starts at the first pose, standing. Below
    a sofa or a table floor goes on, and a range is all that tells of it. So ranges also go into evidence of their own,
    which no floor takes away. What does is a range behind it, on whose line of sight it would lie, the car itself, and
    time. A turn may lead to what was never ranged because it is nearer than the least range: in turns both rows are
    compared for that, a few times a second. A differential drive turns on the spot where others back.

    Args:
        rig, dt, params: as `Controller`.

    Raises:
        InputError: numbers out of range.
    """

    name, Params, modes = "ranging", RangingParams, (CRUISE, TURN, SUPPRESSED, STOPPED, REVERSE)
    backend, checks_near = "numba", True

    def __init__(self, rig: StereoRig, dt: float, params: RangingParams | None = None) -> None:
        super().__init__(rig, dt, params)
        if not 0 < dt < math.inf:
            raise InputError(f"dt must be a positive number of seconds, got {dt}")
        p: RangingParams = self.params
        self.view, self.size, self.a = floor_view(rig, p.floor), (rig.height, rig.width), smoothing_factor(TAU_HIGH, dt)
        self.tables: RangingTables = ranging_tables(rig, p, self.view, dt)
        self.spin = spin_arcs(p) if p.body.spins else None
        self.every = max(1, round(SEARCH_INTERVAL_S / dt))
        self.sizes = sizes_of(self.start(None, Pose(0.0, 0.0, 0.0)))

    @property
    def fields(self) -> tuple[Rect, Rect]:
        """The cells, and inward of them what the other camera needs to see the floor of its own cells again."""
        return self.view.rects

    @property
    def trace(self) -> Trace:
        """How the free distances on both sides compare."""
        return Trace("free distance on arcs to the left - to the right", unit="m")

    def see(self, frames: Frames, state: Any = None) -> tuple[Any, Any]:
        """Cells of `see_floor`, and the state of the filters, `[2, h, w]`."""
        view = self.view
        grey, low = (np.empty(shape, np.float32) for shape in view.shape)
        cells = np.empty((4, *view.x.shape[1:]), np.float32)
        before, frames = low if state is None else checked(state, low.shape), at_rects(frames, view.rects, self.size)
        check_peak(see_floor(frames, state is None, before, self.a, view.firsts, view.shift, grey, low, cells))
        return cells, low

    def sides(self, seen: Any) -> Any:
        """The largest cell of each image."""
        return seen[:2].reshape(2, -1).max(1)

    def start(self, seen: Any, pose: Pose) -> RangingState:
        """The state of a car that stands at a pose and knows nothing."""
        floor = FloorState(np.zeros(self.view.bands, np.float32), 0.0, 0)
        grid = empty_grid(pose.x, pose.y, self.params.grid, self.params.overhangs)
        return RangingState(floor, grid, empty_path(), SUPPRESSED, 0, 1.0, 0, 0.0, 0, 0.0)

    def step(
        self, seen: Any, ranges: Ranges, pose: Pose, driven: Command, state: RangingState
    ) -> tuple[Command, RangingState]:
        """Remember what is seen, measure the free arcs, decide, and limit the speed: see `ranging_step`."""
        check_sizes(state, self.sizes)
        places = (ranges.x, ranges.y, ranges.valid)
        speed, curvature, after = ranging_step(seen, places, tuple(pose), tuple(driven), state, self.tables)
        command = Command(speed, curvature)
        return (command, after) if self.spin is None else self.spun(command, after, pose)

    def spun(self, command: Command, state: RangingState, pose: Pose) -> tuple[Command, RangingState]:
        """The command with a turn on the spot where the car would back, or cannot go on with a turn.

        It turns to the side that was chosen, or to the other one if only that is free, until the way ahead is clear.
        """
        p, t = self.params, self.tables
        if self.spin is None or state.mode not in (REVERSE, STOPPED, TURN) or state.floor.age <= t.floor.learning:
            return command, state
        first = len(t.x) - len(t.arcs.x)
        free = self.free(state, pose, t.arcs._replace(x=t.x[first:], y=t.y[first:]))[0]
        wide, tight = (WIDE_LEFT, TIGHT_LEFT) if state.turn_side > 0 else (WIDE_RIGHT, TIGHT_RIGHT)
        if state.mode == TURN and max(free[wide], free[tight]) >= p.min_free_m:
            return command, state
        if free[AHEAD] >= p.cruise_above_m:
            return Command(p.tight_speed_m_per_s, 0.0), state._replace(mode=TURN)
        turn = self.turn_on_spot(state, pose, state.turn_side, seen=True)
        return (command, state) if turn is None else (turn, state._replace(turn_side=math.copysign(1, turn.curvature)))

    def turn_on_spot(self, state: RangingState, pose: Pose, side: float, seen: bool = False) -> Command | None:
        """A turn to a side, positive for the left, or to the other one where only there is room; None where nowhere is.

        Args:
            seen: only where the whole circle was seen free.
        """
        assert self.spin is not None
        around = self.free(state, pose, self.spin)[int(seen)] / self.spin.step
        for sign in (1.0, -1.0) if side > 0 else (-1.0, 1.0):
            if around[0 if sign > 0 else 1] > MIN_STEPS - 0.5:
                return Command(TURN_RATE * SPOT_RADIUS, sign / SPOT_RADIUS)
        return None

    def free(self, state: RangingState, pose: Pose, arcs: Primitives) -> Array:
        """Free lengths of arcs, and those seen free, `[2, A]` m."""
        g, size = self.tables.grid, state.grid.evidence.shape[0]
        at = cell_index(arcs.x, arcs.y, tuple(pose), g.cell, size)
        return free_distances(costs(state.grid, g.blocked), at, arcs, g.blocked, g.unknown)

    def on_near_obstacles(self, state: RangingState, pose: Pose, scan: ProximityScan) -> RangingState:
        """As `Controller.on_near_obstacles`."""
        return state._replace(grid=mark_stop(state.grid, tuple(pose), scan, BLOCKED, self.params.grid))

    def sensing_requests(self, state: RangingState) -> SensingRequest:
        """As `Controller.sensing_requests`: every `SEARCH_INTERVAL_S`; in turns also what is too near to be ranged.

        No frame has both, as long as there is one between: the longest step counts.
        """
        since = state.age % self.every
        near = since == self.every // 2 and state.mode == TURN
        return SensingRequest(since == 0, near) if self.params.overhangs else SensingRequest()

    def on_extra_ranges(
        self, state: RangingState, pose: Pose, ranges: Ranges | None, obstacles: Obstacles | None
    ) -> RangingState:
        """As `Controller.on_extra_ranges`."""
        grid, g = state.grid, self.tables.grid
        if ranges is not None:
            raised = grid.raised.copy()
            add_ranges(raised, (ranges.x, ranges.y, ranges.valid), tuple(pose), g, SEARCH_EVIDENCE, g.miss)
            grid = grid._replace(raised=raised.clip(-g.least, g.most))
        if obstacles is not None:
            grid = mark_obstacles(grid, tuple(pose), *obstacles, RANGE_EVIDENCE, self.params.grid)
        return state._replace(grid=grid)

    def can_resume(self, state: RangingState) -> bool:
        """As `Controller.can_resume`: it knows its floor."""
        return state.floor.age > self.tables.floor.learning and bool((state.floor.level > 0).all())

    def status_message(self, state: RangingState) -> str | None:
        """As `Controller.status_message`."""
        floor, noisy = state.floor, state.floor.noise > MIN_NOISE
        if state.mode == STOPPED and floor.age <= self.tables.floor.standing:
            why = ", and the images are noisy" if noisy else ": an obstacle, or a floor that shows too little"
            return f"it cannot begin: less than {START_FREE_M} body units of floor are seen free ahead{why}"
        known = known_ratio(floor, self.tables.floor)
        why = "the images are noisy" if noisy else "the floor shows little, or it is dark"
        return None if known >= FULL_RATIO else f"floor is told from noise in {100 * known:.0f} % of the view: {why}"

    def mode(self, state: RangingState) -> int:
        """What the car is doing; `SUPPRESSED` is the start, `STOPPED` boxed in."""
        return state.mode

    def difference(self, state: RangingState) -> float:
        """Length of the free arcs on the left minus the right, m."""
        return state.difference

    def warm_up(self) -> None:
        """Search results go into the grid by a function of their own."""
        none, pose = np.zeros(1, np.float32), Pose(0.0, 0.0, 0.0)
        self.on_extra_ranges(
            self.start(None, pose), pose, Ranges(none, none, none, none, none, none > 0), Obstacles(none, none)
        )


def ranging_tables(
    rig: StereoRig, params: RangingParams, view: FloorView, dt: float, seen_through: float = 0.0
) -> RangingTables:
    """All that is fixed of a step.

    Args:
        seen_through: evidence that a range takes from every cell before it.
    """
    p, g = params, params.grid
    wide, tight = 1 / p.turn_radius_m, 1 / p.tight_radius_m
    arcs = [(0.0, 1), (wide, 1), (tight, 1), (-wide, 1), (-tight, 1), (-tight, -1), (0.0, -1), (tight, -1)]
    longest = math.floor(min(1.6, g.reach - 0.5) / g.cell_m) * g.cell_m
    primitives = motion_primitives(arcs, p.body, p.safety_margin_m, longest, g.cell_m, CRUISE_SPEED * p.body.reaction_s)
    along, across = np.linspace(-0.4, 0.4, 6) * p.body.length_m, np.linspace(-0.4, 0.4, 5) * p.body.width_m
    x, y = np.meshgrid(along, across, indexing="ij")
    grid = GridNumbers(
        cell=float(g.cell_m),
        keep=math.exp(-dt / g.lifetime_s),
        fade=math.exp(-dt / BOXED_IN_S),
        reach=float(g.reach),
        least=float(g.max_free_evidence),
        most=float(g.max_evidence),
        range_weight=RANGE_EVIDENCE,
        blocked=BLOCKED,
        unknown=-0.1 * BLOCKED,
        beam_forward=float(rig.forward),
        beam_left=rig.baseline / 2,
        miss=MISS_EVIDENCE,
        seen_through=float(seen_through),
        cells_per_m=(LINE_TO - LINE_FROM) / (LINE_PLACES - 1) / g.cell_m,
    )
    return RangingTables(
        floor_tables(rig, p.floor, p.speed_m_per_s, view, dt),
        grid,
        primitives,
        packed(p, tight_speed=p.tight_speed_m_per_s, reverse_speed=p.reverse_speed_m_per_s, dt=float(dt)),
        np.concatenate((view.x.ravel(), x.ravel(), primitives.x)).astype(np.float32),
        np.concatenate((view.y.ravel(), y.ravel(), primitives.y)).astype(np.float32),
        x.size,
    )


def spin_arcs(params: RangingParams) -> Primitives:
    """Half a turn on the spot to the left, and one to the right."""
    arcs, step = [(1 / SPOT_RADIUS, 1), (-1 / SPOT_RADIUS, 1)], SPOT_RADIUS * math.pi / STEPS
    turns = motion_primitives(arcs, params.body, params.safety_margin_m, SPOT_RADIUS * math.pi, step)
    # All of the outline swings into what the cameras have not ahead of them.
    return turns._replace(leading=turns.x.size // (len(arcs) * STEPS))


def sizes_of(state: RangingState) -> tuple[Any, ...]:
    """Of the arrays of a state."""
    grid = state.grid
    return state.floor.level.shape, grid.evidence.shape, grid.tag.shape, grid.raised.shape, state.path.poses.shape


def check_sizes(state: RangingState, sizes: tuple[Any, ...]) -> None:
    """Raise `InputError` for a state of another controller: compiled code does not look at sizes."""
    if sizes_of(state) != sizes:
        raise InputError(f"state.control must have arrays of {sizes}, got {sizes_of(state)}")
