"""Compiled: the step of the ranging controller of one car: remember what is seen, decide, and limit the speed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ndtorch.navigation.controllers.contract import CRUISE, REVERSE, STOPPED, SUPPRESSED, TURN
from ndtorch.navigation.controllers.ranging.floor import (
    FULL_RATIO,
    STOP_RATIO,
    FloorState,
    FloorTables,
    floor_step,
    known_ratio,
)
from ndtorch.navigation.local_grid._kernels import (
    DrivenPath,
    GridNumbers,
    LocalGrid,
    Primitives,
    add_ranges,
    bound,
    cell_index,
    costs,
    free_distances,
    move_grid,
    pure_pursuit_back,
    record,
)
from ndtorch.navigation.stereo._kernels import Array
from ndtorch.utils.jit import jit

Place = tuple[float, float, float]
"""x and y, m, and heading, radians."""

AHEAD, WIDE_LEFT, TIGHT_LEFT, WIDE_RIGHT, TIGHT_RIGHT, BACK_RIGHT, BACK, BACK_LEFT = range(8)
"""The arcs whose free lengths are known, as `ranging_tables` makes them; those behind by the sign of curvature."""

UNDER_THE_CAR = 2.0
"""Evidence that a place under the car loses in a step."""

UNSEEN_SPEED, MIN_TURN_S = 0.2, 0.3
"""Highest speed into what was not seen free, m/s; and a turn lasts at least so long."""

WIDE_TURN_MIN_M, UNKNOWN_MARGIN_M = 1.3, 0.1
"""Free length that a wide turn needs, and distance that turns and reversing go into what was not seen free, m."""

SIDE_HYSTERESIS_M, KNOWN_RATIO = 0.25, 0.5
"""The side to turn to changes only when the arcs on the other are longer by the first, m; arcs that are known to be
floor count by the second more."""

REAR_M, SWING_M, WIDE_SWING_M, REVERSED_M, ROOM_M = 0.1, 0.3, 0.6, 0.15, 0.9
"""Free lengths behind the car, m: below the first there is none; that turning backward needs; with that it turns on
although its path leads back; what it reverses at least before it goes ahead; and what must then be free on an arc."""

START_FREE_M, START_GOES_ON = 0.7, 0.65
"""A car that does not know its floor yet begins where so much is free ahead, m; one that has begun learns its floor
while this ratio of it is free: it drives 0.2 m meanwhile."""

SETTLED = 0.95
"""Noise that falls below so much of what it was a step before has not settled yet."""


class RangingState(NamedTuple):
    """State of `RangingControl`: of one car, or of several with every part `[...]` longer.

    Attributes:
        floor: what was learned of the floor.
        grid: what is remembered of the surroundings.
        path: where the car has just driven.
        mode: what the car is doing.
        age: time steps since that began.
        turn_side: +1 turns to the left, -1 to the right.
        reverse_turning: 1 when reversing turns the car on towards that side, 0 when it goes back on its path or
            straight.
        reversed_m: metres reversed.
        has_reversed: 1 from reversing to the next cruise: the car has backed once and now turns into what it has not
            seen free.
        difference: length of the free arcs on the left minus the right, m.
    """

    floor: FloorState
    grid: LocalGrid
    path: DrivenPath
    mode: int
    age: int
    turn_side: float
    reverse_turning: int
    reversed_m: float
    has_reversed: int
    difference: float


class RangingTables(NamedTuple):
    """All that is fixed of a step.

    Attributes:
        numbers: of `RangingParams`, packed, with `tight_speed`, `reverse_speed` and `dt`.
        x, y: places of the cells of floor, of the floor under the car, and of the arcs, body frame, m.
        under: how many places there are under the car.
    """

    floor: FloorTables
    grid: GridNumbers
    arcs: Primitives
    numbers: Array
    x: Array
    y: Array
    under: int


@jit
def ranging_step(
    cells: Array,
    ranges: tuple[Array, Array, Array],
    pose: Place,
    driven: tuple[float, float],
    state: RangingState,
    tables: RangingTables,
) -> tuple[float, float, RangingState]:
    """`RangingControl.step`: speed, curvature and the new state."""
    noise = state.floor.noise
    lengths, state = remember(cells, ranges, pose, driven, state, tables)
    speed, curvature, state = decide(lengths, pose, driven, state, tables)
    return limit(speed, curvature, state, lengths[0, 0], noise, tables)


@jit
def with_floor(state: RangingState, floor: FloorState, mode: int) -> RangingState:
    s = state
    rest = s.turn_side, s.reverse_turning, s.reversed_m, s.has_reversed, s.difference
    return RangingState(floor, s.grid, s.path, mode, s.age, *rest)


@jit
def remember(
    cells: Array,
    ranges: tuple[Array, Array, Array],
    pose: Place,
    driven: tuple[float, float],
    state: RangingState,
    tables: RangingTables,
) -> tuple[Array, RangingState]:
    """Judge the cells of floor, bring the grid up to date and measure the free arcs.

    Args:
        cells: of `see_floor`, `[4, bands, blocks]`.
        ranges: x, y and valid, `[n]`.
        pose, driven: where the car is, and the speed and curvature that it drove to get there.

    Returns:
        Lengths of the arcs up to what blocks them and up to what is not known, `[2, A]` m, and the new state.
    """
    g, s, mode = tables.grid, state, state.mode
    if mode == STOPPED and s.floor.age <= tables.floor.standing and not s.floor.level.any():
        mode = SUPPRESSED  # a car that stood because it could not begin tries to begin again
    marks = np.empty((2, cells.shape[1], cells.shape[2]), np.float32)
    floor = floor_step(cells, driven, s.floor, tables.floor, marks)
    grid = move_grid(s.grid, pose, g.cell, g.fade if mode == STOPPED else g.keep)
    at = cell_index(tables.x, tables.y, pose, g.cell, grid.tag.shape[1])
    body = at[marks.size : marks.size + tables.under]
    add_ranges(grid.evidence, ranges, pose, g, g.range_weight, g.seen_through)
    evidence, weights = grid.evidence.reshape(-1), marks.reshape(-1)
    for k in range(weights.size):
        evidence[at[k]] += weights[k]
    for k in body:
        evidence[k] -= UNDER_THE_CAR
    bound(grid.evidence, -g.least, g.most)
    if grid.raised.size:
        add_ranges(grid.raised, ranges, pose, g, g.range_weight, g.miss)
        raised = grid.raised.reshape(-1)
        for k in body:
            raised[k] -= g.least
        bound(grid.raised, -g.least, g.most)
    arcs = at[marks.size + tables.under :]
    lengths = free_distances(costs(grid, g.blocked), arcs, tables.arcs, g.blocked, g.unknown)
    # A wall that is nearer than the floor in view may be at any distance: before it only what was seen free is free.
    if grid.raised.size and 2 * (marks[:, 0] > 0).sum() > marks[:, 0].size:
        lengths[0] = np.minimum(lengths[0], lengths[1])
    path, rest = record(s.path, pose, driven[0]), (s.turn_side, s.reverse_turning, s.reversed_m, s.has_reversed)
    return lengths, RangingState(floor, grid, path, mode, s.age, *rest, s.difference)


@jit
def next_mode(
    mode: int,
    learning: bool,
    blocked_ahead: bool,
    clear: bool,
    blocked_sides: bool,
    reverse_done: bool,
    blocked_rear: bool,
) -> int:
    """The transitions.

    Args:
        learning: the car has not learned yet what floor looks like.
        blocked_ahead: less is free straight ahead than a turn wants.
        clear: enough is free straight ahead, and the turn has lasted its shortest time.
        blocked_sides: neither arc to the side of the turn leaves enough to drive on.
        reverse_done: reversed as far as intended or until an arc ahead is long again, or nothing is left behind.
        blocked_rear: nothing is left behind the car either.
    """
    if mode == SUPPRESSED and learning:
        return SUPPRESSED
    if (mode in (SUPPRESSED, CRUISE) and not blocked_ahead) or (mode == TURN and clear):
        return CRUISE
    if mode == REVERSE:
        return TURN if reverse_done else REVERSE
    if blocked_sides:
        return STOPPED if blocked_rear else REVERSE
    return TURN


@jit(exact=True)
def decide(
    lengths: Array, pose: Place, driven: tuple[float, float], state: RangingState, tables: RangingTables
) -> tuple[float, float, RangingState]:
    """The next mode and its speed and curvature.

    Args:
        lengths, pose, driven, state: of `remember`.
    """
    p, s, floor, free, known = tables.numbers[0], state, tables.floor, lengths[0], lengths[1]
    arcs = free + KNOWN_RATIO * known
    difference = float(arcs[WIDE_LEFT] + arcs[TIGHT_LEFT] - arcs[WIDE_RIGHT] - arcs[TIGHT_RIGHT])
    reversing, side = s.mode == REVERSE, s.turn_side
    # A turn and what belongs to it stays on its side; else the longer arcs decide.
    if not (reversing or s.mode == TURN or abs(difference) < SIDE_HYSTERESIS_M):
        side = 1.0 if difference > 0 else -1.0
    wide_arc, tight_arc = (WIDE_LEFT, TIGHT_LEFT) if side > 0 else (WIDE_RIGHT, TIGHT_RIGHT)
    back_arc = BACK_RIGHT if side > 0 else BACK_LEFT
    wide = min(free[wide_arc], known[wide_arc] + UNKNOWN_MARGIN_M)
    longest = max(wide, min(free[tight_arc], known[tight_arc] + UNKNOWN_MARGIN_M))
    # No camera looks back: there only what was seen free is free.
    swing_back, straight_back = min(free[back_arc], known[back_arc]), min(free[BACK], known[BACK])
    track, follow = pure_pursuit_back(s.path, pose, 1 / p.tight_radius_m)
    # Where the body came from it was free all along, whatever is remembered of it. But only turning on brings a car
    # out of a corner: it does so where there is much room.
    turning = s.reverse_turning
    if not reversing:
        turning = 1 if swing_back > SWING_M and (track < REAR_M or swing_back > WIDE_SWING_M) else 0
    tracked = track >= REAR_M and turning == 0
    rear = track if tracked else swing_back if turning else straight_back
    # Before a turn into what was not seen free the car backs once, if it knows that it can.
    unseen = longest < p.min_free_m and rear >= SWING_M and not s.has_reversed
    gone, age = (s.reversed_m - driven[0] * p.dt if reversing else 0.0), s.age + 1
    room = gone >= min(REVERSED_M, p.reverse_m) and longest >= ROOM_M
    mode = next_mode(
        s.mode,
        s.floor.age < floor.learning,
        free[AHEAD] < p.turn_below_m,
        free[AHEAD] >= p.cruise_above_m and age >= round(MIN_TURN_S / p.dt),
        max(free[wide_arc], free[tight_arc]) < p.min_free_m or unseen,
        (gone >= p.reverse_m and not tracked) or rear < REAR_M or room,
        rear < REAR_M,
    )
    # Once tight, a turn stays tight until its arc is long.
    speed, curvature = p.speed_m_per_s, 0.0
    if mode == TURN:
        roomy = wide >= WIDE_TURN_MIN_M
        slow = p.tight_speed if longest >= p.min_free_m else min(UNSEEN_SPEED, p.speed_m_per_s)
        speed, curvature = (speed if roomy else slow), side / (p.turn_radius_m if roomy else p.tight_radius_m)
    elif mode == REVERSE:
        speed = -p.reverse_speed
        curvature = follow if tracked else -side / p.tight_radius_m if turning else 0.0
    if mode == STOPPED or s.floor.age <= floor.standing:
        speed = 0.0
    backed = 1 if mode == REVERSE else 0 if mode == CRUISE else s.has_reversed
    rest = (age if mode == s.mode else 0), side, turning, gone, backed, difference
    return speed, curvature, RangingState(s.floor, s.grid, s.path, mode, *rest)


@jit(exact=True)
def limit(
    speed: float, curvature: float, state: RangingState, ahead: float, noise: float, tables: RangingTables
) -> tuple[float, float, RangingState]:
    """Stand where the path ahead is not long enough to begin, and go only as fast as floor is told from noise.

    What is taken for noise changes only while the wheels stand. Somebody who walks past a standing car is noise for as
    long, and a car that drives off as soon as the first floor is told from it goes slowly until it stands again: so it
    stands on until the noise has settled.

    Args:
        speed, curvature, state: wanted.
        ahead: free distance straight ahead, m.
        noise: of the state before the step.
    """
    floor, t = state.floor, tables.floor
    ratio, learning = (known_ratio(floor, t) - STOP_RATIO) / (FULL_RATIO - STOP_RATIO), floor.age <= t.learning
    if ratio >= 1 and not learning:
        return speed, curvature, state
    stands = ratio <= 0 or (ratio < 1 and floor.noise < SETTLED * noise)
    # What comes near while the car learns ends that: to stand before it, and begin again, would bring the car nearer.
    begun = floor.age > t.standing + 1 and floor.level.min() > 0
    if learning and ahead < (START_GOES_ON if begun else 1.0) * START_FREE_M:
        if begun:
            floor = FloorState(floor.level, floor.noise, t.learning + 1)
        else:
            age = floor.age if floor.age <= t.standing else 0  # what is near is checked before it begins again
            floor, stands = FloorState(np.zeros_like(floor.level), floor.noise, age), True
    if stands:
        return 0.0, 0.0, with_floor(state, floor, np.intp(STOPPED))
    return (speed * min(ratio, 1.0) if speed > 0 else speed), curvature, with_floor(state, floor, state.mode)
