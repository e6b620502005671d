"""A stop layer for commands from outside, as Nav2's collision monitor, with two cameras in place of a lidar.

It is the loop of a car whose `ranging` controller sees and remembers what is around, while the command comes from
somebody else: the guard passes it on, slower where its path is not long, or stands.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.errors import InputError
from ndtorch.navigation import CRUISE, TURN, Pose
from ndtorch.navigation.body import braking_speed
from ndtorch.navigation.controllers.ranging._kernels import RangingState
from ndtorch.navigation.controllers.ranging._kernels_floor import known_share, speed_share
from ndtorch.navigation.local_grid._kernels import cell_index, costs, free_distances
from ndtorch.navigation.local_grid.motion_primitives import motion_primitives
from ndtorch_robot.navigator_runner import NavigatorRunner
from ndtorch_robot.ports import STAND, DriveCommand

Array = npt.NDArray[Any]

LONGEST = 1.6
"""Length of the path ahead that is looked at, in units of the body, m: the grid reaches no farther at all sides."""

CURVED = 0.5
"""Curvature from which on both rows are compared for what is near, as in turns of the controller, 1/m."""

GO = 1e-3
"""A wish of a lower speed is a stand, m/s."""


BRAKE_SHARE, SEEING_S = 0.6, 0.05
"""It counts on this share of the acceleration of the body, and on this time beside its reaction until it brakes, s."""

STOP, RESUME = 0.1, 0.3
"""It stands where less than the first is free, and goes on where the second is, in units of the body, m."""

STATIONARY_M = 0.002
"""A pose that changes by less from step to step is that of a car that stands, m and rad."""

UNSEEN_SPEED = 0.3
"""It drives no faster than this into what was not seen free, in units of the body, m/s."""


class Guard:
    """What `Car.steer` is for a guarded car: the wish, as far as there is room for it.

    Until the floor is known, which takes .5 s of driving, a wish ahead is driven straight, and only with
    `RangingParams.start_free_m` free; any other is a stand.

    Args:
        runner: of a car with the controller `ranging`.
        wish: the command from outside.

    Attributes:
        free: how far the path of the wish was free, m.
        stopped: whether it stands, although it is asked to go.

    Raises:
        InputError: another controller.
    """

    def __init__(self, runner: NavigatorRunner, wish: Callable[[], DriveCommand]) -> None:
        controller: Any = runner.navigator.controller
        self.unit = float(getattr(controller, "unit", 1.0))
        self.control = getattr(controller, "inner", controller)
        if self.control.name != "ranging":
            raise InputError(f"a guard sees with the controller 'ranging', got {self.control.name!r}")
        self.runner, self.wish = runner, wish
        self.free, self.stopped, self.steps = 0.0, False, 0
        self.held: tuple[Pose, Array] | None = None

    def __call__(self, wanted: DriveCommand) -> DriveCommand:
        """The command to send; `wanted`, of the `ranging` controller, counts while the floor is learned."""
        wish, state = self.wish(), self.runner.state
        if state is None:
            return STAND
        control: RangingState = state.control
        floor = self.control.tables.floor
        going = abs(wish.speed) > GO
        if control.floor.age <= floor.learning:
            self.stopped = going and not (wish.speed > 0 and wanted.speed > 0)
            if wish.speed > GO:
                return DriveCommand(min(wish.speed, wanted.speed), 0.0)
            # Nothing is learned while it stands: the time for that begins with the first wish to go ahead.
            age = min(control.floor.age, floor.standing)
            kept = control.floor._replace(level=np.zeros_like(control.floor.level), age=age)
            self.put(control._replace(floor=kept))
            return STAND
        # What the controller itself would do does not matter, but what it remembers does: boxed in it would forget.
        self.steps += 1
        mode = TURN if abs(wish.curvature) * self.unit > CURVED else CRUISE
        self.put(control._replace(mode=mode, age=self.steps, has_reversed=0))
        if not going:
            self.stopped = False
            return STAND
        most = self.speed_limit(wish, control)
        self.stopped = most <= 0
        return DriveCommand(math.copysign(min(abs(wish.speed), most), wish.speed), wish.curvature)

    def put(self, control: RangingState) -> None:
        assert self.runner.state is not None
        self.runner.state = self.runner.state._replace(control=control)

    def speed_limit(self, wish: DriveCommand, control: RangingState) -> float:
        """The speed from which the car stops within what is free on the path of the wish, m/s; 0 is a stop."""
        unit = self.unit
        free, seen = (unit * length for length in self.lengths(wish, control))
        # No camera looks backward, nor into a turn: there only what was seen free before, or driven over, counts.
        blind = wish.speed < 0 or abs(wish.curvature) * unit > CURVED
        self.free = free = min(free, seen) if blind else free
        if free < unit * (RESUME if self.stopped else STOP):
            return 0.0
        most = self.stops_within(free)
        if wish.speed > 0:
            most = min(most, max(self.stops_within(seen), UNSEEN_SPEED * unit))
            share = speed_share(known_share(control.floor, self.control.tables.floor))
            most = most if share >= 1 else min(most, share * self.control.params.speed_m_per_s * unit)
        return most

    def costs(self, control: RangingState) -> Array:
        """Costs of the local grid; while the car stands, what was blocked stays so until it is seen free.

        From where it stands it may not see again what it saw on the path to it.
        """
        g, pose = self.control.tables.grid, self.runner.state.pose  # type: ignore[union-attr]
        found = np.array(costs(control.grid, g.blocked))
        if self.held is not None and math.dist(self.held[0], pose) < STATIONARY_M:
            found = np.where((self.held[1] >= g.blocked) & (found >= g.unknown), self.held[1], found)
        self.held = pose, found
        return found

    def stops_within(self, length: float) -> float:
        """The speed from which the car stops within a length, reaction included, m/s."""
        body = self.runner.body
        return braking_speed(length, BRAKE_SHARE * body.max_acceleration_m_per_s2, body.reaction_s + SEEING_S)

    def lengths(self, wish: DriveCommand, control: RangingState) -> tuple[float, float]:
        """How far the path of the wish is free, and how far it was seen free, in units of the body."""
        p, pose = self.control.params, self.runner.state.pose  # type: ignore[union-attr]
        forward = 1 if wish.speed > 0 else -1
        arc = motion_primitives(
            [(wish.curvature * self.unit, forward)], p.body, p.safety_margin_m, LONGEST, p.grid.cell_m, lag=0.05
        )
        here = (float(pose.x) / self.unit, float(pose.y) / self.unit, float(pose.heading))
        at = cell_index(arc.x, arc.y, here, p.grid.cell_m, p.grid.size_cells)
        g = self.control.tables.grid
        found = free_distances(self.costs(control), at, arc, g.blocked, g.unknown)
        return float(found[0, 0]), float(found[1, 0])
