"""The controller that goes beyond the paper: it drives where it has seen floor."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation import local_grid
from ndtorch.navigation.body import CRUISE_SPEED, SPOT_RADIUS, Body
from ndtorch.navigation.controllers.contract import (
    CRUISE,
    REVERSE,
    STOPPED,
    SUPPRESSED,
    TURN,
    Command,
    Controller,
    register,
)
from ndtorch.navigation.controllers.ranging import _kernels as kernels
from ndtorch.navigation.controllers.ranging._kernels import FloorState, RangingState, RangingTables
from ndtorch.navigation.controllers.ranging.floor import BLOCKS, FloorView, floor_view
from ndtorch.navigation.local_grid import DrivenPath, LocalGridParams, Primitives
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity import NOWHERE, Obstacles, ProximityScan
from ndtorch.navigation.stereo._kernels import Frames, packed
from ndtorch.navigation.stereo.ranging import TAU_HIGH, Ranges
from ndtorch.navigation.stereo.rig import StereoRig
from ndtorch.navigation.stereo.strips import at_rects, check_peak, checked
from ndtorch.vision.temporal import smoothing_factor

NEAR_INTERVAL_S, BOXED_IN_S = 0.17, 1.0
"""A car that turns looks so often for what is near; one that is boxed in forgets with the second time constant."""

TURN_RATE = 0.8  # radians a second of a turn on the spot, as in a tight turn of the car of [A]

STEPS, MIN_STEPS = 9, 3
"""Steps of 20 degrees of half a turn on the spot that are looked at, and fewest of them for a turn to begin."""


@dataclass(frozen=True)
class RangingParams:
    """Parameters of the ranging controller.

    Args:
        speed_m_per_s: Speed ahead and in wide turns.
        turn_radius_m: Radius of a wide turn.
        tight_radius_m: Radius of a tight turn.
        turn_below_m: A turn starts when less than this is free straight ahead.
        cruise_above_m: A turn ends when this is free straight ahead.
        min_free_m: The car drives on while this is free; with less it reverses.
        reverse_m: Distance over which the car reverses.
        safety_margin_m: Distance that is kept free around the body.
        overhangs: What was ranged stays in the path although floor is seen there, as below sofas.
        body: Outline of the car.
        grid: Parameters of the local grid.
    """

    speed_m_per_s: float = 0.5
    turn_radius_m: float = 1.0
    tight_radius_m: float = 0.5
    turn_below_m: float = 1.1
    cruise_above_m: float = 1.4
    min_free_m: float = 0.2
    reverse_m: float = 0.5
    safety_margin_m: float = 0.07
    overhangs: bool = True
    body: Body = field(default_factory=Body)
    grid: LocalGridParams = field(default_factory=LocalGridParams)

    def __post_init__(self) -> None:
        check_numbers(self, positive=vars(self))

    @property
    def tight_speed_m_per_s(self) -> float:
        return min(0.4, 0.8 * self.speed_m_per_s)

    @property
    def reverse_speed_m_per_s(self) -> float:
        return min(0.3, self.speed_m_per_s)


@register
class RangingControl(Controller):
    """Drives where floor was seen, and away from where it ends or a range says that something is.

    What is seen are the cells of `see_floor`, `[4, bands, blocks]`. The state starts at the first pose, standing. Below
    a sofa or a table floor goes on, and a range is all that tells of it. So ranges also go into evidence of their own,
    which no floor takes away. What does is a range behind it, on whose line of sight it would lie, the car itself, and
    time. A turn may lead to what was never ranged because it is nearer than the least range: in turns both rows are
    compared for that, a few times a second. A differential drive turns on the spot where others back.
    """

    name = "ranging"
    Params: ClassVar[type[Any]] = RangingParams
    modes: ClassVar[tuple[int, ...]] = (CRUISE, TURN, SUPPRESSED, STOPPED, REVERSE)
    backend, checks_near = "numba", True
    seen_through = 0.0
    """Evidence that a range takes from every cell before it."""

    def __init__(self, rig: StereoRig, dt: float, params: Any = None) -> None:
        super().__init__(rig, dt, params)
        if not 0 < dt < math.inf:
            raise InputError(f"dt must be a positive number of seconds, got {dt}")
        self.reactive = p = self.reactive_params()
        self.view, self.size, self.a = floor_view(rig), (rig.height, rig.width), smoothing_factor(TAU_HIGH, dt)
        self.fields, self.blank = self.view.rects, np.zeros(self.view.shape, np.float32)
        self.tables: RangingTables = ranging_tables(rig, p, self.view, dt, self.seen_through)
        self.spin = spin_arcs(p) if p.body.spins else None
        self.every = max(1, round(NEAR_INTERVAL_S / dt))

    def reactive_params(self) -> RangingParams:
        params: RangingParams = self.params
        return params

    def see(self, frames: Frames, state: Any = None) -> tuple[Any, Any, Any]:
        """Cells of `see_floor`, the largest of each image, and the state of the filters, `[2, h, w]`."""
        view, blank = self.view, self.blank
        cells = np.empty((4, *view.x.shape[1:]), np.float32)
        low = blank if state is None else checked(state, blank.shape)
        frames = at_rects(frames, view.rects, self.size)
        low, peak = kernels.see_floor(frames, state is None, low, self.a, view.reads, view.shift, cells)
        check_peak(peak)
        return cells, cells[:2].reshape(2, -1).max(1), low

    def start(self, seen: Any, pose: Pose) -> Any:
        floor = FloorState(np.zeros(self.view.bands, np.float32), 0.0, 0)
        grid = local_grid.empty_grid(pose.x, pose.y, self.reactive.grid, self.reactive.overhangs)
        path = DrivenPath(np.zeros((local_grid.POSES, 3), np.float32), 0)
        return RangingState(floor, grid, path, SUPPRESSED, 0, 1.0, 0, 0.0, 0, 0.0)

    def step(self, seen: Any, ranges: Ranges, pose: Pose, driven: Command, state: Any) -> tuple[Command, Any]:
        self.check_sizes(state)
        places = (ranges.x, ranges.y, ranges.valid)
        speed, curvature, after = kernels.ranging_step(seen, places, tuple(pose), tuple(driven), state, self.tables)
        command = Command(speed, curvature)
        return (command, after) if self.spin is None else self.spun(command, after, pose)

    def check_sizes(self, state: RangingState) -> None:
        """Raise `InputError` for a state of another controller: compiled code does not look at sizes."""
        grid, size, bands = state.grid, self.reactive.grid.size_cells, self.view.bands
        given = state.floor.level.shape, grid.evidence.shape, grid.tag.shape, state.path.poses.shape
        wanted = (bands,), (size, size), (2, size), (local_grid.POSES, 3)
        if given != wanted or grid.raised.size != self.reactive.overhangs * size**2:
            raise InputError(f"state.control must have arrays of {wanted}, got {given}")

    def spun(self, command: Command, state: RangingState, pose: Pose) -> tuple[Command, RangingState]:
        """The command with a turn on the spot where the car would back, or cannot go on with a turn.

        It turns to the side that was chosen, or to the other one if only that is free, until the way ahead is clear.
        """
        p, t = self.reactive, self.tables
        if state.mode not in (REVERSE, STOPPED, TURN) or state.floor.age <= t.numbers[0]["learning"]:
            return command, state
        first = len(t.x) - len(t.arcs.x)
        free = kernels.free_lengths(state.grid, tuple(pose), t.arcs, t.x[first:], t.y[first:], p.grid.cell_m)[0]
        wide, tight = (
            (kernels.WIDE_LEFT, kernels.TIGHT_LEFT)
            if state.turn_side > 0
            else (kernels.WIDE_RIGHT, kernels.TIGHT_RIGHT)
        )
        if state.mode == TURN and max(free[wide], free[tight]) >= p.min_free_m:
            return command, state
        if free[kernels.AHEAD] >= p.cruise_above_m:
            return Command(p.tight_speed_m_per_s, 0.0), state._replace(mode=TURN)
        turn = self.turn_on_spot(state, pose, state.turn_side, seen=True)
        return (command, state) if turn is None else (turn, state._replace(turn_side=math.copysign(1, turn.curvature)))

    def turn_on_spot(self, state: RangingState, pose: Pose, side: float, seen: bool = False) -> Command | None:
        """A turn to a side, positive for the left, or to the other one where only there is room; None where nowhere is.

        With `seen` only where the whole circle was seen free.
        """
        arcs, cell = self.spin, self.reactive.grid.cell_m
        assert arcs is not None
        around = kernels.free_lengths(state.grid, tuple(pose), arcs, arcs.x, arcs.y, cell)[int(seen)] / arcs.step
        for sign in (1.0, -1.0) if side > 0 else (-1.0, 1.0):
            if around[0 if sign > 0 else 1] > MIN_STEPS - 0.5:
                return Command(TURN_RATE * SPOT_RADIUS, sign / SPOT_RADIUS)
        return None

    def on_near_obstacles(self, state: Any, pose: Pose, scan: ProximityScan) -> Any:
        return state._replace(grid=kernels.mark_scan(state.grid, tuple(pose), scan, self.reactive.grid.cell_m))

    def look_again(self, state: Any, pose: Pose, near: Callable[[], Obstacles]) -> Any:
        """As `Controller.look_again`: in turns, every `NEAR_INTERVAL_S`."""
        if not self.reactive.overhangs or state.mode != TURN or state.age % self.every != self.every // 2:
            return state
        return state._replace(grid=kernels.mark_near(state.grid, tuple(pose), *near(), self.tables.numbers))

    def can_resume(self, state: Any) -> bool:
        return bool(state.floor.age > self.tables.numbers[0]["learning"] and (state.floor.level > 0).all())

    def status_message(self, state: Any) -> str | None:
        floor, noisy = state.floor, state.floor.noise > kernels.MIN_NOISE
        if state.mode == STOPPED and floor.age <= self.tables.numbers[0]["standing"]:
            why = ", and the images are noisy" if noisy else ": an obstacle, or a floor that shows too little"
            return f"it cannot begin: less than {kernels.START_FREE_M} body units of floor are seen free ahead{why}"
        known = kernels.known_ratio(floor, self.tables)
        why = "the images are noisy" if noisy else "the floor shows little, or it is dark"
        return (
            None
            if known >= kernels.FULL_RATIO
            else f"floor is told from noise in {100 * known:.0f} % of the view: {why}"
        )

    def warm_up(self) -> None:
        pose = Pose(0.0, 0.0, 0.0)
        state = self.start(None, pose)
        self.on_near_obstacles(state, pose, ProximityScan(NOWHERE, True, NOWHERE, NOWHERE))
        if self.reactive.overhangs:
            self.look_again(state._replace(age=self.every // 2, mode=TURN), pose, lambda: NOWHERE)


def ranging_tables(
    rig: StereoRig, params: RangingParams, view: FloorView, dt: float, seen_through: float
) -> RangingTables:
    p, g = params, params.grid
    wide, tight = 1 / p.turn_radius_m, 1 / p.tight_radius_m
    arcs = [(0.0, 1), (wide, 1), (tight, 1), (-wide, 1), (-tight, 1), (-tight, -1), (0.0, -1), (tight, -1)]
    longest = math.floor(min(1.6, g.reach - 0.5) / g.cell_m) * g.cell_m
    primitives = local_grid.motion_primitives(
        arcs, p.body, p.safety_margin_m, longest, g.cell_m, CRUISE_SPEED * p.body.reaction_s
    )
    along, across = np.linspace(-0.4, 0.4, 6) * p.body.length_m, np.linspace(-0.4, 0.4, 5) * p.body.width_m
    x, y = np.meshgrid(along, across, indexing="ij")
    standing = round(kernels.STANDING_S / dt)
    derived = {
        "tight_speed": p.tight_speed_m_per_s,
        "reverse_speed": p.reverse_speed_m_per_s,
        "dt": float(dt),
        "keep": math.exp(-dt / g.lifetime_s),  # shares of the evidence that stay, as a rule and boxed in
        "fade": math.exp(-dt / BOXED_IN_S),
        "reach": float(g.reach),
        "forward": float(rig.forward),  # origin of the lines of sight
        "beam_left": 0.0 if seen_through else rig.baseline / 2,
        "seen_through": float(seen_through),
        "points_per_m": (local_grid.LINE_TO - local_grid.LINE_FROM) / (local_grid.LINE_PLACES - 1) / g.cell_m,
        "yaw": float(rig.focal * dt),
        "standing": standing,  # time steps until the car begins, and until it knows its floor
        "learning": standing + max(1, round(kernels.LEARNING_S / dt)),
        "adaptation": dt / kernels.ADAPTATION_S / (2 * BLOCKS),
    }
    cells, under = (view.x.ravel(), view.y.ravel()), (x.ravel(), y.ravel())
    places = np.concatenate((cells, under, primitives[2:4]), 1).astype(np.float32)
    return RangingTables(
        packed(p, g, **derived),
        ((view.sweep * dt) ** 2).astype(np.float32),
        # Far floor is finer than a pixel and gives less; before its own level is learned this is a fair guess.
        (1.0 - 0.5 * (view.depth - 1.2)).clip(0.3, 1.0).astype(np.float32),
        (-np.expm1(-view.sweep * dt * p.speed_m_per_s / kernels.SATURATION_PX)).astype(np.float32),
        primitives,
        places[0],
        places[1],
        x.size,
    )


def spin_arcs(params: RangingParams) -> Primitives:
    arcs, step = [(1 / SPOT_RADIUS, 1), (-1 / SPOT_RADIUS, 1)], SPOT_RADIUS * math.pi / STEPS
    turns = local_grid.motion_primitives(arcs, params.body, params.safety_margin_m, SPOT_RADIUS * math.pi, step)
    # All of the outline swings into what the cameras have not ahead of them.
    return turns._replace(leading=turns.x.size // (len(arcs) * STEPS))
