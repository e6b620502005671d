"""Turns on the spot of a differential drive, in place of backing out."""

from __future__ import annotations

import math
from typing import NamedTuple

from ndtorch.navigation.body import SPOT_RADIUS
from ndtorch.navigation.controllers.contract import REVERSE, STOPPED, TURN, Command
from ndtorch.navigation.controllers.ranging._kernels import (
    AHEAD,
    TIGHT_LEFT,
    TIGHT_RIGHT,
    WIDE_LEFT,
    WIDE_RIGHT,
    RangingState,
    RangingTables,
)
from ndtorch.navigation.controllers.ranging.params import RangingParams
from ndtorch.navigation.local_grid._kernels import Array, Primitives, cell_index, costs, free_distances
from ndtorch.navigation.local_grid.motion_primitives import motion_primitives
from ndtorch.navigation.odometry import Pose

TURN_RATE = 0.8
"""Radians a second, as in a tight turn of the car of [A]."""

STEPS, MIN_STEPS = 9, 3
"""Steps of 20 degrees of half a turn that are looked at, and fewest of them for a turn to begin."""


class Spin(NamedTuple):
    """What a turn on the spot needs.

    Attributes:
        arcs: to the left and to the right.
        under: places before those of `RangingTables.arcs` in its `x` and `y`.
        min_free_m, cruise_above_m, speed_m_per_s: as in `RangingParams`.
    """

    arcs: Primitives
    under: int
    min_free_m: float
    cruise_above_m: float
    speed_m_per_s: float


def spin_of(params: RangingParams, tables: RangingTables) -> Spin | None:
    """The turns of a body; None for one that cannot turn on the spot."""
    p, step = params, SPOT_RADIUS * math.pi / STEPS
    if not p.body.spins:
        return None
    arcs = [(1 / SPOT_RADIUS, 1), (-1 / SPOT_RADIUS, 1)]
    primitives = motion_primitives(arcs, p.body, p.safety_margin_m, SPOT_RADIUS * math.pi, step)
    # All of the outline swings into what the cameras have not ahead of them.
    primitives = primitives._replace(leading=primitives.x.size // (len(arcs) * STEPS))
    under = len(tables.x) - len(tables.arcs.x)
    return Spin(primitives, under, p.min_free_m, p.cruise_above_m, p.tight_speed_m_per_s)


def lengths(cost: Array, pose: Pose, places: tuple[Array, Array], arcs: Primitives, tables: RangingTables) -> Array:
    """Free lengths of arcs, and those seen free, `[2, A]` m, whose outlines pass through places of the body frame."""
    at = cell_index(*places, tuple(pose), tables.grid.cell, cost.shape[0])
    return free_distances(cost, at, arcs, tables.grid.blocked, tables.grid.unknown)


def spun(
    command: Command, state: RangingState, pose: Pose, spin: Spin, tables: RangingTables
) -> tuple[Command, RangingState]:
    """The command with a turn on the spot where the car would back, or cannot go on with a turn.

    It turns to the side that was chosen, or to the other one if only that is free, until the way ahead is clear.
    """
    if state.mode not in (REVERSE, STOPPED, TURN) or state.floor.age <= tables.floor.learning:
        return command, state
    cost = costs(state.grid, tables.grid.blocked)
    free = lengths(cost, pose, (tables.x[spin.under :], tables.y[spin.under :]), tables.arcs, tables)[0]
    wide, tight = (WIDE_LEFT, TIGHT_LEFT) if state.turn_side > 0 else (WIDE_RIGHT, TIGHT_RIGHT)
    if state.mode == TURN and max(free[wide], free[tight]) >= spin.min_free_m:
        return command, state
    if free[AHEAD] >= spin.cruise_above_m:
        return Command(spin.speed_m_per_s, 0.0), state._replace(mode=TURN)
    turn = turn_on_spot(cost, pose, state.turn_side, spin, tables, seen=True)
    return (command, state) if turn is None else (turn, state._replace(turn_side=math.copysign(1.0, turn.curvature)))


def turn_on_spot(
    cost: Array, pose: Pose, side: float, spin: Spin, tables: RangingTables, seen: bool = False
) -> Command | None:
    """A turn to a side, positive for the left, or to the other one where only there is room; None where nowhere is.

    Args:
        seen: only where the whole circle was seen free.
    """
    around = lengths(cost, pose, (spin.arcs.x, spin.arcs.y), spin.arcs, tables)[int(seen)] / spin.arcs.step
    sides = (1.0, -1.0) if side > 0 else (-1.0, 1.0)
    room = (side for side in sides if around[0 if side > 0 else 1] > MIN_STEPS - 0.5)
    return next((Command(TURN_RATE * SPOT_RADIUS, side / SPOT_RADIUS) for side in room), None)
