"""Compiled: the step of the ranging controller of one car: remember what is seen, decide, and limit the speed."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ndtorch.navigation.controllers.contract import CRUISE, REVERSE, STOPPED, SUPPRESSED, TURN
from ndtorch.navigation.controllers.ranging._kernels_floor import (
    FloorNumbers,
    FloorState,
    floor_step,
    known_share,
    speed_share,
)
from ndtorch.navigation.controllers.ranging.modes import Facts, next_mode
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
from ndtorch.utils.jit import jit

Array = Any
"""A NumPy array."""

Place = tuple[float, float, float]
"""x and y, m, and heading, radians."""


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


class DecisionNumbers(NamedTuple):
    """`RangingParams` for one time step, as `decide` and `limit` take them; radii are curvatures, times are steps."""

    speed: float
    tight_speed: float
    reverse_speed: float
    unseen_speed: float
    wide: float
    tight: float
    turn_below_m: float
    cruise_above_m: float
    wide_turn_min_m: float
    min_free_m: float
    turn_steps: int
    reverse_length: float
    room: float
    side_hysteresis_m: float
    known_ratio: float
    unknown_margin_m: float
    start_needs: float
    dt: float


class RangingTables(NamedTuple):
    """All that is fixed of a step.

    Attributes:
        decision: `packed` `DecisionNumbers`.
        x, y: places of the cells of floor, of the floor under the car, and of the arcs, body frame, m.
        under: how many places there are under the car.
    """

    floor: FloorNumbers
    grid: GridNumbers
    arcs: Primitives
    decision: Array
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
    before, noise = awake(state, tables.floor), state.floor.noise
    lengths, state = remember(cells, ranges, pose, driven, before, tables)
    speed, curvature, state = decide(lengths, pose, driven, state, tables)
    return limit(speed, curvature, state, lengths[0, 0], noise, tables)


@jit
def awake(state: RangingState, numbers: FloorNumbers) -> RangingState:
    """The state before a step: a car that stood because it could not begin tries to begin again."""
    floor = state.floor
    if state.mode != STOPPED or floor.age > numbers.standing:
        return state
    for level in floor.level:
        if level != 0:
            return state
    return with_mode(state, floor, np.intp(SUPPRESSED))


@jit
def with_mode(state: RangingState, floor: FloorState, mode: int) -> RangingState:
    s = state
    return RangingState(
        floor,
        s.grid,
        s.path,
        mode,
        s.age,
        s.turn_side,
        s.reverse_turning,
        s.reversed_m,
        s.has_reversed,
        s.difference,
    )


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
    g, kind = tables.grid, np.float32
    marks = np.empty((2, cells.shape[1], cells.shape[2]), np.float32)
    floor = floor_step(cells, driven, state.floor, tables.floor, marks)
    grid = move_grid(state.grid, pose, g.cell, g.fade if state.mode == STOPPED else g.keep)
    at = cell_index(tables.x, tables.y, pose, g.cell, grid.tag.shape[1])
    body = at[marks.size : marks.size + tables.under]
    add_ranges(grid.evidence, ranges, pose, g, g.range_weight, g.seen_through)
    evidence, weights = grid.evidence.reshape(-1), marks.reshape(-1)
    for k in range(weights.size):
        evidence[at[k]] += weights[k]
    for k in range(body.size):
        evidence[body[k]] -= kind(UNDER_THE_CAR)
    bound(grid.evidence, -g.least, g.most)
    if grid.raised.size:
        add_ranges(grid.raised, ranges, pose, g, g.range_weight, g.miss)
        raised = grid.raised.reshape(-1)
        for k in range(body.size):
            raised[body[k]] -= kind(g.least)
        bound(grid.raised, -g.least, g.most)
    arcs = at[marks.size + tables.under :]
    lengths = free_distances(costs(grid, g.blocked), arcs, tables.arcs, g.blocked, g.unknown)
    # A wall that is nearer than the floor in view may be at any distance: before it only what was seen free is free.
    if grid.raised.size and 2 * (marks[:, 0] > 0).sum() > marks[:, 0].size:
        lengths[0] = np.minimum(lengths[0], lengths[1])
    s = state
    after = RangingState(
        floor,
        grid,
        record(s.path, pose, driven[0]),
        s.mode,
        s.age,
        s.turn_side,
        s.reverse_turning,
        s.reversed_m,
        s.has_reversed,
        s.difference,
    )
    return lengths, after


AHEAD, WIDE_LEFT, TIGHT_LEFT, WIDE_RIGHT, TIGHT_RIGHT, BACK_RIGHT, BACK, BACK_LEFT = range(8)
"""The arcs whose free lengths are known, as `ranging_tables` makes them; those behind by the sign of curvature."""

UNDER_THE_CAR = 2.0
"""Evidence that a place under the car loses in a step."""

REAR_M, SWING_M, WIDE_SWING_M, REVERSED_M = 0.1, 0.3, 0.6, 0.15
"""Free lengths behind the car, m: below the first there is none; that turning backward needs; with that it turns on
although its path leads back; and what it reverses at least before it goes ahead."""


@jit(exact=True)
def decide(
    lengths: Array, pose: Place, driven: tuple[float, float], state: RangingState, tables: RangingTables
) -> tuple[float, float, RangingState]:
    """The next mode and its speed and curvature.

    Args:
        lengths, pose, driven, state: of `remember`.
    """
    p, s, floor = tables.decision[0], state, tables.floor
    free, known = lengths[0], lengths[1]
    difference = float(free[WIDE_LEFT] + free[TIGHT_LEFT] - free[WIDE_RIGHT] - free[TIGHT_RIGHT])
    difference += p.known_ratio * float(known[WIDE_LEFT] + known[TIGHT_LEFT] - known[WIDE_RIGHT] - known[TIGHT_RIGHT])
    reversing, side = s.mode == REVERSE, s.turn_side
    # A turn and what belongs to it stays on its side; else the longer arcs decide.
    if not (reversing or s.mode == TURN or abs(difference) < p.side_hysteresis_m):
        side = 1.0 if difference > 0 else -1.0 if difference < 0 else 0.0
    wide_arc, tight_arc = (WIDE_LEFT, TIGHT_LEFT) if side > 0 else (WIDE_RIGHT, TIGHT_RIGHT)
    back_arc = BACK_RIGHT if side > 0 else BACK_LEFT
    margin = p.unknown_margin_m
    wide = min(free[wide_arc], known[wide_arc] + margin)
    tight = min(free[tight_arc], known[tight_arc] + margin)
    longest = max(wide, tight)
    blocked = max(free[wide_arc], free[tight_arc]) < p.min_free_m
    # No camera looks back: there only what was seen free is free.
    swing_back, straight_back = min(free[back_arc], known[back_arc]), min(free[BACK], known[BACK])
    track, follow = pure_pursuit_back(s.path, pose, p.tight)
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
    facts = Facts(
        s.floor.age < floor.learning,
        free[AHEAD] < p.turn_below_m,
        free[AHEAD] >= p.cruise_above_m and age >= p.turn_steps,
        blocked or unseen,
        (gone >= p.reverse_length and not tracked) or rear < REAR_M,
        gone >= min(REVERSED_M, p.reverse_length) and longest >= p.room,
        rear < REAR_M,
    )
    mode = next_mode(s.mode, facts)
    # Once tight, a turn stays tight until its arc is long.
    roomy, speed, curvature = wide >= p.wide_turn_min_m, p.speed, 0.0
    if mode == TURN:
        speed = p.speed if roomy else p.tight_speed if longest >= p.min_free_m else p.unseen_speed
        curvature = side * (p.wide if roomy else p.tight)
    elif mode == REVERSE:
        speed = -p.reverse_speed
        curvature = follow if tracked else -side * p.tight if turning else 0.0
    elif mode == STOPPED:
        speed = 0.0
    if s.floor.age <= floor.standing:
        speed = 0.0
    bold = 1 if mode == REVERSE else 0 if mode == CRUISE else s.has_reversed
    after = age if mode == s.mode else 0
    return speed, curvature, RangingState(s.floor, s.grid, s.path, mode, after, side, turning, gone, bold, difference)


SETTLED = 0.95
"""Noise that falls below so much of what it was a step before has not settled yet."""

START_GOES_ON = 0.65
"""A car that has begun learns its floor while this share of `start_needs` is free: it drives 0.2 m meanwhile."""


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
    floor, p = state.floor, tables.floor
    share, learning = speed_share(known_share(floor, p)), floor.age <= p.learning
    if share >= 1 and not learning:
        return speed, curvature, state
    stands = share <= 0 or (share < 1 and floor.noise < SETTLED * noise)
    # What comes near while the car learns ends that: to stand before it, and begin again, would bring the car nearer.
    begun = floor.age > p.standing + 1 and floor.level.min() > 0
    if learning and ahead < (START_GOES_ON if begun else 1.0) * tables.decision[0].start_needs:
        if begun:
            floor = FloorState(floor.level, floor.noise, p.learning + 1)
        else:
            age = floor.age if floor.age <= p.standing else 0  # what is near is checked before it begins again
            floor, stands = FloorState(np.zeros_like(floor.level), floor.noise, age), True
    mode = STOPPED if stands else state.mode
    if stands:
        speed, curvature = 0.0, 0.0
    elif speed > 0:
        speed *= share
    return speed, curvature, with_mode(state, floor, mode)
