"""The controller that goes beyond the paper: it drives where it has seen floor."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from ndtorch.errors import InputError
from ndtorch.navigation.controllers.contract import (
    CRUISE,
    REVERSE,
    STOPPED,
    SUPPRESSED,
    TURN,
    Command,
    Controller,
    SensingRequest,
    Task,
    Trace,
)
from ndtorch.navigation.controllers.ranging._kernels import RangingState, RangingTables, ranging_step
from ndtorch.navigation.controllers.ranging._kernels_floor import FULL_SHARE, FloorState, known_share, see_floor
from ndtorch.navigation.controllers.ranging.floor_view import floor_view, view_numbers
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.controllers.ranging.spin import spin_of, spun
from ndtorch.navigation.controllers.ranging.tables import floor_numbers, ranging_tables
from ndtorch.navigation.controllers.registry import register
from ndtorch.navigation.local_grid._kernels import add_ranges
from ndtorch.navigation.local_grid.grid import empty_grid, empty_path, mark_obstacles, mark_stop
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.proximity.stereo_match import Obstacles, ProximityScan
from ndtorch.navigation.stereo._kernels import Frames
from ndtorch.navigation.stereo.ranging import Ranges
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch.navigation.stereo.strips import at_rects, check_peak, checked


@register
class RangingControl(Controller):
    """Drives where floor was seen, and away from where it ends or a range says that something is.

    What is seen are the cells of `see_floor`, `[4, bands, blocks]`. The state starts at the first pose, standing. Below
    a sofa or a table floor goes on, and a range is all that tells of it. So ranges also go into evidence of their own,
    which no floor takes away. What does is a range behind it, on whose line of sight it would lie, the car itself, and
    time. A turn may lead to what was never ranged because it is nearer than the least range: in turns both rows are
    compared for that, a few times a second.

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
        self.rig, self.dt, self.view = rig, dt, floor_view(rig, p.floor)
        self.numbers = view_numbers(rig, p.floor, self.view, dt)
        self.tables: RangingTables = ranging_tables(rig, p, self.view, dt)
        self.spin = spin_of(p, self.tables)
        self.size = (rig.height, rig.width)
        v = self.numbers
        self.shape = (2, v.tall * v.bands, v.wide * v.blocks)
        self.every = max(1, round(p.search_interval_s / dt))
        self.sizes = sizes_of(self.start(None, Pose(0.0, 0.0, 0.0)))

    @classmethod
    def params_for(cls, task: Task) -> RangingParams:
        """As `Controller.params_for`; tight turns and reversing are never faster than the rest."""
        params: RangingParams = super().params_for(task)
        return params.no_faster(task.speed)

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
        v = self.numbers
        cells, low = np.empty((4, v.bands, v.blocks), np.float32), np.empty(self.shape, np.float32)
        here = at_rects(frames, self.view.rects, self.size)
        before = low if state is None else checked(state, self.shape)
        check_peak(see_floor(here, state is None, before, v, low, cells))
        return cells, low

    def sides(self, seen: Any) -> Any:
        """The largest cell of each image."""
        return seen[:2].reshape(2, -1).max(1)

    def start(self, seen: Any, pose: Pose) -> RangingState:
        """The state of a car that stands at a pose and knows nothing."""
        p: RangingParams = self.params
        floor = FloorState(np.zeros(p.floor.bands, np.float32), 0.0, 0)
        grid = empty_grid(pose.x, pose.y, p.grid, p.overhangs)
        return RangingState(floor, grid, empty_path(), SUPPRESSED, 0, 1.0, 0, 0.0, 0, 0.0)

    def step(
        self, seen: Any, ranges: Ranges, pose: Pose, driven: Command, state: RangingState
    ) -> tuple[Command, RangingState]:
        """Remember what is seen, measure the free arcs, decide, and limit the speed: see `ranging_step`."""
        check_sizes(state, self.sizes)
        speed, curvature, after = ranging_step(
            seen, (ranges.x, ranges.y, ranges.valid), tuple(pose), tuple(driven), state, self.tables
        )
        command = Command(speed, curvature)
        return (command, after) if self.spin is None else spun(command, after, pose, self.spin, self.tables)

    def on_near_obstacles(self, state: RangingState, pose: Pose, scan: ProximityScan) -> RangingState:
        """As `Controller.on_near_obstacles`."""
        p: RangingParams = self.params
        grid = mark_stop(state.grid, tuple(pose), scan, p.blocked_evidence, p.grid)
        return state._replace(grid=grid)

    def sensing_requests(self, state: RangingState) -> SensingRequest:
        """As `Controller.sensing_requests`: every `search_interval_s`; in turns also what is too near to be ranged.

        No frame has both, as long as there is one between: the longest step counts.
        """
        if not self.params.overhangs:
            return SensingRequest()
        since = state.age % self.every
        return SensingRequest(since == 0, since == self.every // 2 and state.mode == TURN)

    def on_extra_ranges(
        self, state: RangingState, pose: Pose, ranges: Ranges | None, obstacles: Obstacles | None
    ) -> RangingState:
        """As `Controller.on_extra_ranges`."""
        grid, p, g = state.grid, self.params, self.tables.grid
        if ranges is not None:
            raised = grid.raised.copy()
            add_ranges(raised, (ranges.x, ranges.y, ranges.valid), tuple(pose), g, float(p.search_evidence), g.miss)
            np.clip(raised, -g.least, g.most, raised)
            grid = grid._replace(raised=raised)
        if obstacles is not None:
            grid = mark_obstacles(grid, tuple(pose), *obstacles, p.range_evidence, p.grid)
        return state._replace(grid=grid)

    def can_resume(self, state: RangingState) -> bool:
        """As `Controller.can_resume`: it knows its floor."""
        return state.floor.age > self.tables.floor.learning and bool((state.floor.level > 0).all())

    def status_message(self, state: RangingState) -> str | None:
        """As `Controller.status_message`."""
        floor, p = state.floor, self.params
        if state.mode == STOPPED and floor.age <= self.tables.floor.standing:
            noisy = ", and the pictures are noisy" * (floor.noise > p.min_noise_output)
            why = noisy or ": something stands there, or the floor shows too little to both cameras"
            return f"it cannot begin: less than {p.start_free_m} m of floor are seen free ahead{why}"
        share = known_share(floor, self.tables.floor)
        if share >= FULL_SHARE:
            return None
        why = "the pictures are noisy" if floor.noise > p.min_noise_output else "the floor shows little, or it is dark"
        return f"floor is told from noise in {100 * share:.0f} % of the view: {why}"

    def at_speed(self, speed: float) -> None:
        """Judge the floor for another full speed, m/s."""
        floor = floor_numbers(self.rig, replace(self.params, speed_m_per_s=speed), self.view, self.dt)
        self.tables = self.tables._replace(floor=floor)

    def mode(self, state: RangingState) -> int:
        """What the car is doing; `SUPPRESSED` is the start, `STOPPED` boxed in."""
        return state.mode

    def difference(self, state: RangingState) -> float:
        """Length of the free arcs on the left minus the right, m."""
        return state.difference

    def warm_up(self) -> None:
        """Search results go into the grid by a function of their own."""
        none = np.zeros(1, np.float32)
        nothing = Ranges(none, none, none, none, none, none > 0)
        self.on_extra_ranges(self.start(None, Pose(0.0, 0.0, 0.0)), Pose(0.0, 0.0, 0.0), nothing, Obstacles(none, none))


def sizes_of(state: RangingState) -> tuple[Any, ...]:
    """Of the arrays of a state."""
    grid = state.grid
    return state.floor.level.shape, grid.evidence.shape, grid.tag.shape, grid.raised.shape, state.path.poses.shape


def check_sizes(state: RangingState, sizes: tuple[Any, ...]) -> None:
    """Raise `InputError` for a state of another controller: compiled code does not look at sizes."""
    found = sizes_of(state)
    if found != sizes:
        raise InputError(f"state.control must have arrays of {sizes}, got {found}")
