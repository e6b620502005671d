"""Compiled: the step of the ranging controller of one car: see the floor, remember, decide, and limit the speed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.navigation.controllers.contract import CRUISE, REVERSE, STOPPED, SUPPRESSED, TURN
from ndtorch.navigation.controllers.ranging.floor import EVERY
from ndtorch.navigation.local_grid import (
    DrivenPath,
    LocalGrid,
    Place,
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
from ndtorch.navigation.proximity import ProximityScan
from ndtorch.navigation.stereo._kernels import Array, Frames, cell_maxima, grey_fields
from ndtorch.utils.jit import jit
from ndtorch.vision.nondirectional import SPEED_SCALE

MIN_CHANGE, MAX_GAIN, DARK = 0.01, 2.0, 0.01
"""Illumination: changes up to the first ratio are left alone, as much comes from texture that moves past; no lamp
changes by more than the second factor from one frame to the next; means below the third say nothing of the light."""

MIN_CORRELATION, MIN_TEXTURE = 0.7, 0.002
"""One floor has this correlation of both images, and changes from pixel to pixel of this ratio of white, at least."""

SATURATION_PX, TOLERANCE = 1.2, 2.1
"""Image speed, pixels a step, at which the output of floor reaches 63 % of its largest; and a cell shows something else
than floor when its output is more than this factor below or above what the floor gave lately at this speed."""

STANDING_S, LEARNING_S, ADAPTATION_S = 0.1, 0.4, 5.0
"""The car stands at the start, to measure the noise of the cameras, drives straight on to learn what its floor looks
like, and learns after that with this time constant, from cells that look like floor."""

MIN_SIGNAL = 1.5  # floor is unknown where its low threshold is less than this many times the noise

UPRIGHT_BANDS, TRUSTED = 3, 0.25
"""An object stands where both cameras see no one floor in so many bands of a block, and none behind; the cameras must
agree on floor in this ratio of the cells that both see to be believed about that."""

FLOOR_EVIDENCE, END_EVIDENCE = 0.5, 1.0
"""A cell that looks like floor becomes free by the first in a frame, one in which it ends blocked by the second."""

LEAST, MOVING, STILL, NOISE_RATIO, MIN_NOISE = 1e-6, 0.1, 0.001, 0.3, 0.005
"""Smallest output that counts; m/s from which the floor is learned, and below which the wheels stand: a car that goes
from forward to backward passes through 0 while its image still moves; ratio of a step when noise is measured; and
output that the 256 levels of an image alone make."""

STOP_RATIO, FULL_RATIO = 0.25, 0.75
"""Ratios of the bands of floor that are known up to which the car stands, and from which on it is fast."""

AHEAD, WIDE_LEFT, TIGHT_LEFT, WIDE_RIGHT, TIGHT_RIGHT, BACK_RIGHT, BACK, BACK_LEFT = range(8)
"""The arcs whose free lengths are known, as `ranging_tables` makes them; those behind by the sign of curvature."""

RANGE_EVIDENCE, MISS_EVIDENCE, BLOCKED = 1.0, 0.15, 1.9
"""A cell with a range in it becomes blocked by the first; a range takes the second from each raised cell on its line of
sight; a cell is blocked from the third on, and known floor below -0.19."""

UNKNOWN = -0.1 * BLOCKED  # evidence from which a cell was not seen free
UNDER_THE_CAR = 2.0  # evidence that a place under the car loses in a step

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

SETTLED = 0.95  # noise that falls below so much of what it was a step before has not settled yet


class FloorState(NamedTuple):
    """What one car has learned of the floor."""

    level: Array  # output of fast moving floor, `[bands]`; 0 while nothing is learned
    noise: float  # output while standing
    age: int  # time steps since the start


class RangingState(NamedTuple):
    """State of `RangingControl`: of one car, or of several with every part `[...]` longer."""

    floor: FloorState  # what was learned of the floor
    grid: LocalGrid  # what is remembered of the surroundings
    path: DrivenPath  # where the car has just driven
    mode: int  # what the car is doing
    age: int  # time steps since that began
    turn_side: float  # +1 turns to the left, -1 to the right
    # 1 when reversing turns the car on towards that side, 0 when it goes back on its path or straight
    reverse_turning: int
    reversed_m: float  # metres reversed
    # 1 from reversing to the next cruise: the car has backed once and now turns into what it has not seen
    # free
    has_reversed: int
    difference: float  # length of the free arcs on the left minus the right, m


class RangingTables(NamedTuple):
    """All that is fixed of a step."""

    numbers: Array  # of `RangingParams` and its grid, packed, and what `ranging_tables` derives of them
    flow: Array  # squared image speed of the floor at 1 m/s, pixels a step, `[bands]`
    profile: Array  # first guess of the level over that of near floor, `[bands]`
    full: Array  # ratio of its level that floor shows at full speed, `[bands]`
    arcs: Primitives  # outlines along the arcs
    # x, y: places of the cells of floor, of the floor under the car, and of the arcs, body frame, m
    x: Array
    y: Array
    under: int  # how many places there are under the car


@jit
def see_floor(
    frames: Frames, settle: bool, low: Array, a: float, reads: tuple[int, int, int], shift: Array, cells: Array
) -> tuple[Array, float]:
    """Image speed and stereo match of every cell of floor; returns the state of the filters and the largest change.

    Args:
        settle: the filters start at rest on this frame.
        low: state of the filters, `[2, h, w]`.
        a: ratio of the high-pass.
        reads, shift: of `FloorView`.
        cells: becomes `[4, bands, blocks]`, nearest band and outermost block first: image speeds of the left and the
            right camera, then 1 where both see one floor, 0 where they do not, -1 where only one sees the cell.
    """
    _, bands, blocks = cells.shape
    grey, own, new_low = np.empty((2, low.shape[1], reads[2]), np.float32), np.empty_like(low), np.empty_like(low)
    finite = grey_fields(frames, EVERY, grey)
    for eye in range(2):
        own[eye] = grey[eye, :, reads[eye] : reads[eye] + low.shape[2]]
    match_cells(grey, (reads[0], reads[1]), shift, low.shape[2] // blocks, cells[2:])
    before = low if settle else low * np.float32(illumination_gain(own, low, bands, blocks))
    maxima = np.empty((2, bands, blocks), np.float32)
    peak = cell_maxima(own, settle, before, a, new_low, maxima)
    cells[0] = maxima[0, ::-1] * np.float32(SPEED_SCALE)
    cells[1] = maxima[1, ::-1, ::-1] * np.float32(SPEED_SCALE)
    return new_low, peak if finite else np.nan


@jit
def illumination_gain(grey: Array, low: Array, bands: int, blocks: int) -> float:
    """How much brighter the light is than in the state of the filters: lamps that flicker are not motion.

    The top rows of the cells of both cameras are compared with themselves, and their median counts. So what comes into
    view does not matter, as long as it fills less than half of the cells.
    """
    tall, wide = low.shape[1] // bands, low.shape[2] // blocks
    ratios, n = np.empty(2 * bands * blocks, np.float32), 0
    for eye in range(2):
        for y in range(0, tall * bands, tall):
            for x in range(0, wide * blocks, wide):
                now, before = grey[eye, y, x : x + wide].sum(), low[eye, y, x : x + wide].sum()
                ratios[n] = max(now, DARK * wide) / max(before, DARK * wide)
                n += 1
    # NaN has no place in an order; it is reported by the maxima of the cells.
    gain = lower_median(ratios) if math.isfinite(ratios.sum()) else 1.0
    return gain if abs(gain - 1) > MIN_CHANGE and 1 / MAX_GAIN < gain < MAX_GAIN else 1.0


@jit
def match_cells(grey: Array, firsts: tuple[int, int], shift: Array, wide: int, common: Array) -> None:
    """Whether each cell, with the one behind it, is one floor: 1; -1 where the other camera does not see it, else 0.

    Floor is seen `focal * baseline / depth` columns apart, fewer in every row that is farther up; a wall is seen as far
    apart in all rows as its foot. So a cell of floor looks alike in both images along these lines, and a wall does not.
    The changes from pixel to pixel are compared, less their means: neither light nor the foot of a wall, which lies in
    one row of both images, makes rows alike.
    """
    _, bands, blocks = common.shape
    tall, width, n = grey.shape[1] // bands, grey.shape[2], wide - 1
    sums, rows = np.zeros((2, bands + 1, blocks, 3), np.float32), np.zeros((2, bands + 1, blocks), np.int64)
    for y in range(0, grey.shape[1], EVERY):
        band = bands - 1 - y // tall
        for eye in range(2):
            own, other, away = grey[eye, y], grey[1 - eye, y], -shift[y] if eye else shift[y]
            for k in range(blocks):
                x = firsts[eye] + wide * k
                if x + away >= 0 and x + away + n < width:
                    block = blocks - 1 - k if eye else k
                    add_changes(own[x : x + wide], other[x + away : x + away + wide], sums[eye, band, block])
                    rows[eye, band, block] += 1
    for eye in range(2):
        for band in range(bands):
            for k in range(blocks):
                total = sums[eye, band, k] + sums[eye, band + 1, k]
                count = rows[eye, band, k] + rows[eye, band + 1, k]
                same = total[0] > MIN_CORRELATION * math.sqrt(max(total[1], 0.0) * max(total[2], 0.0))
                enough = min(total[1], total[2]) > MIN_TEXTURE**2 * n * count
                common[eye, band, k] = -1 if 2 * EVERY * count < tall else 1 if same and enough else 0


@jit
def add_changes(own: Array, other: Array, sums: Array) -> None:
    """Add products of the changes from pixel to pixel of two rows less their means, and their squares."""
    n = own.shape[0] - 1
    product, square, other_square = np.float32(0), np.float32(0), np.float32(0)
    for x in range(n):
        one, two = own[x + 1] - own[x], other[x + 1] - other[x]
        product, square, other_square = product + one * two, square + one * one, other_square + two * two
    # Changes add up to the difference of the last pixel and the first.
    one, two = own[n] - own[0], other[n] - other[0]
    sums[0] += product - one * two / n
    sums[1] += square - one * one / n
    sums[2] += other_square - two * two / n


@jit
def lower_median(values: Array) -> float:
    return float(np.sort(values)[(values.size - 1) // 2])


@jit(exact=True)
def floor_step(
    cells: Array, driven: tuple[float, float], state: FloorState, tables: RangingTables, evidence: Array
) -> FloorState:
    """One time step: which cells look like floor, and learning how fast floor looks.

    Output grows with image speed v as `level (1 - exp(-v / saturation))`; the level follows the floor. A blank
    wall gives less, the foot of a wall and a textured wall more. So do lines, joints and checks; but there both
    cameras see one floor, and it goes on. What only one camera sees is believed to be an end of the floor as long as
    this camera is not mistaken elsewhere.

    What moves like floor may still be an upright object: a pole straight ahead hardly moves in the image, and while
    the car turns all that is in it moves alike. It hides all floor behind it, up to the horizon. So where both
    cameras see no one floor in some bands of a block, and in none behind them, the floor ends. What only one camera
    sees, as far out as that end or farther in the block beside it, is not called free: it most often shows the same
    object. Both hold only where the cameras agree on enough floor elsewhere: those of a pair that was not measured
    well never do.

    Args:
        cells: of `see_floor`, `[4, bands, blocks]`.
        driven: speed, m/s, and curvature, 1/m, since the last frame.
        evidence: becomes what each cell adds to the grid, `[2, bands, blocks]`.
    """
    t, p, level, noise, age = tables, tables.numbers[0], state.level, state.noise, state.age + 1
    _, bands, blocks = cells.shape
    speed, turning, learning = abs(driven[0]), driven[1] * p.yaw, age <= p.learning
    shape, known, gained = np.empty(bands), np.empty(bands, np.bool_), np.zeros(bands)
    for b in range(bands):
        shape[b] = -math.expm1(-math.sqrt(t.flow[b] + turning * turning) * speed / SATURATION_PX)
        known[b] = level[b] * shape[b] > noise * MIN_SIGNAL * TOLERANCE and not learning
    agreed, shared = (cells[2:] > 0).sum(), (cells[2:] >= 0).sum()
    trusted = agreed > 0 and agreed >= TRUSTED * shared
    excess, floor = np.zeros((bands, blocks)), np.zeros((bands, blocks), np.bool_)
    for eye in range(2):
        common, mistaken = cells[eye + 2], False
        for b in range(bands):
            for k in range(blocks):
                if known[b]:
                    expected = max(level[b] * shape[b], LEAST)
                    excess[b, k] = math.log(max(cells[eye, b, k], LEAST) / expected)
                    floor[b, k] = abs(excess[b, k]) < math.log(TOLERANCE)
                    mistaken = mistaken or (not floor[b, k] and common[b, k] > 0)
        beside = bands
        for k in range(blocks - 1, -1, -1):
            # Where an upright object begins; only the nearest of its cells matters, as nothing behind it is reached.
            foot, none, b = bands, 0, bands - 1
            while trusted and b >= 0 and common[b, k] <= 0:
                none += common[b, k] == 0
                foot = b if common[b, k] == 0 and none >= UPRIGHT_BANDS else foot
                b -= 1
            reached, end = True, bands
            for b in range(bands):
                looks = (floor[b, k] and b != foot) or (known[b] and common[b, k] > 0)
                passes = looks or (mistaken and common[b, k] < 0)
                evidence[eye, b, k] = 0
                if reached and known[b] and not passes:
                    evidence[eye, b, k], end = END_EVIDENCE, b
                elif reached and looks and not (trusted and common[b, k] < 0 and b >= beside):
                    evidence[eye, b, k] = -FLOOR_EVIDENCE
                    gained[b] += excess[b, k] if floor[b, k] else 0.0
                reached = reached and passes
            beside = end
    new_level = level * np.exp(gained * p.adaptation).astype(np.float32)
    if learning and age > p.standing and speed > MOVING:
        # At the start most of the nearest cells are floor: their median is its level.
        near = max(1, bands * 2 // 5)
        steady = cells[:2, :near].copy()
        for b in range(near):
            steady[:, b] /= max(shape[b], MOVING)
        guess, ratio = lower_median(steady.reshape(-1)) * t.profile, 2 / (p.learning - p.standing)
        for b in range(bands):
            new_level[b] = level[b] + ratio * (guess[b] - level[b]) if level[b] > 0 else guess[b]
    if speed < STILL:
        noise += NOISE_RATIO * (lower_median(cells[:2].copy().reshape(-1)) - noise)
    return FloorState(new_level, noise, age)


@jit(exact=True)
def known_ratio(floor: FloorState, tables: RangingTables) -> float:
    """Ratio of the bands in which floor would be told from noise at full speed; 1 while it is learned."""
    p = tables.numbers[0]
    least = max(floor.noise, MIN_NOISE) * MIN_SIGNAL * TOLERANCE
    known = (floor.level * tables.full > least).sum() / floor.level.shape[0]
    return 1.0 if floor.age <= p.learning else float(known)


@jit
def ranging_step(
    cells: Array,
    ranges: tuple[Array, Array, Array],
    pose: Place,
    driven: tuple[float, float],
    state: RangingState,
    tables: RangingTables,
) -> tuple[float, float, RangingState]:
    noise = state.floor.noise
    lengths, state = remember(cells, ranges, pose, driven, state, tables)
    speed, curvature, state = decide(lengths, pose, driven, state, tables)
    return limit(speed, curvature, state, lengths[0, 0], noise, tables)


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

    Returns lengths of the arcs up to what blocks them and up to what is not known, `[2, A]` m, and the new state.

    Args:
        ranges: x, y and valid, `[n]`.
        driven: speed and curvature on the way to the pose.
    """
    p, s, mode = tables.numbers[0], state, state.mode
    if mode == STOPPED and s.floor.age <= p.standing and not s.floor.level.any():
        mode = SUPPRESSED  # a car that stood because it could not begin tries to begin again
    marks = np.empty((2, cells.shape[1], cells.shape[2]), np.float32)
    floor = floor_step(cells, driven, s.floor, tables, marks)
    grid = move_grid(s.grid, pose, p.cell_m, p.fade if mode == STOPPED else p.keep)
    at = cell_index(tables.x, tables.y, pose, p.cell_m, grid.tag.shape[1])
    body = at[marks.size : marks.size + tables.under]
    add_ranges(grid.evidence, ranges, pose, tables.numbers, RANGE_EVIDENCE, p.seen_through)
    evidence, weights = grid.evidence.reshape(-1), marks.reshape(-1)
    for k in range(weights.size):
        evidence[at[k]] += weights[k]
    for k in body:
        evidence[k] -= UNDER_THE_CAR
    bound(grid.evidence, -p.max_free_evidence, p.max_evidence)
    if grid.raised.size:
        add_ranges(grid.raised, ranges, pose, tables.numbers, RANGE_EVIDENCE, MISS_EVIDENCE)
        raised = grid.raised.reshape(-1)
        for k in body:
            raised[k] -= p.max_free_evidence
        bound(grid.raised, -p.max_free_evidence, p.max_evidence)
    arcs = at[marks.size + tables.under :]
    lengths = free_distances(costs(grid, BLOCKED), arcs, tables.arcs, BLOCKED, UNKNOWN)
    # A wall that is nearer than the floor in view may be at any distance: before it only what was seen free is free.
    if grid.raised.size and 2 * (marks[:, 0] > 0).sum() > marks[:, 0].size:
        lengths[0] = np.minimum(lengths[0], lengths[1])
    path, rest = record(s.path, pose, driven[0]), (s.turn_side, s.reverse_turning, s.reversed_m, s.has_reversed)
    return lengths, RangingState(floor, grid, path, mode, s.age, *rest, s.difference)


@jit
def next_mode(
    mode: int,
    learning: bool,  # the car has not learned yet what floor looks like
    blocked_ahead: bool,  # less is free straight ahead than a turn wants
    clear: bool,  # enough is free straight ahead, and the turn has lasted its shortest time
    blocked_sides: bool,  # neither arc to the side of the turn leaves enough to drive on
    reverse_done: bool,  # reversed as far as intended, an arc ahead is long again, or nothing is left behind
    blocked_rear: bool,  # nothing is left behind the car either
) -> int:
    """The transitions."""
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
    """The next mode and its speed and curvature."""
    p, s, free, known = tables.numbers[0], state, lengths[0], lengths[1]
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
        s.floor.age < p.learning,
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
    if mode == STOPPED or s.floor.age <= p.standing:
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
    s, p, level, age = state, tables.numbers[0], state.floor.level, state.floor.age
    ratio = (known_ratio(s.floor, tables) - STOP_RATIO) / (FULL_RATIO - STOP_RATIO)
    stands = ratio <= 0 or (ratio < 1 and s.floor.noise < SETTLED * noise)
    # What comes near while the car learns ends that: to stand before it, and begin again, would bring the car nearer.
    begun = age > p.standing + 1 and level.min() > 0
    if age <= p.learning and ahead < (START_GOES_ON if begun else 1.0) * START_FREE_M:
        if begun:
            age = p.learning + 1
        else:  # what is near is checked before it begins again
            level, age, stands = np.zeros_like(level), (age if age <= p.standing else 0), True
    if stands:
        speed, curvature = 0.0, 0.0
    elif speed > 0:
        speed *= min(ratio, 1.0)
    floor, mode = FloorState(level, s.floor.noise, age), STOPPED if stands else s.mode
    rest = s.turn_side, s.reverse_turning, s.reversed_m, s.has_reversed, s.difference
    return speed, curvature, RangingState(floor, s.grid, s.path, mode, s.age, *rest)


@jit
def free_lengths(grid: LocalGrid, pose: Place, arcs: Primitives, x: Array, y: Array, cell: float) -> Array:
    """Free lengths of arcs, and those seen free, `[2, A]` m; x and y are the places of the arcs, body frame."""
    at = cell_index(x, y, pose, cell, grid.tag.shape[1])
    return free_distances(costs(grid, BLOCKED), at, arcs, BLOCKED, UNKNOWN)


@jit
def mark_scan(grid: LocalGrid, pose: Place, scan: ProximityScan, cell: float) -> LocalGrid:
    """The grid after a proximity check of a standing car.

    Obstacles block at once, and so does a line across the path where no floor is seen; mismatches do not.
    """
    evidence, raised, size, full = grid.evidence.copy(), grid.raised.copy(), grid.tag.shape[1], BLOCKED + 0.1
    cells, above = evidence.reshape(-1), raised.reshape(-1)
    for k in cell_index(scan.across.x, scan.across.y, pose, cell, size):
        cells[k] = min(cells[k], 0.0) if scan.floor_seen else max(cells[k], full)
    for k in cell_index(scan.mismatches.x, scan.mismatches.y, pose, cell, size):
        cells[k] = min(cells[k], 0.0)
        if above.size:
            above[k] = min(above[k], 0.0)
    for k in cell_index(scan.obstacles.x, scan.obstacles.y, pose, cell, size):
        cells[k] = max(cells[k], full)
    return LocalGrid(evidence, grid.tag, raised)


@jit
def mark_near(grid: LocalGrid, pose: Place, x: Array, y: Array, numbers: Array) -> LocalGrid:
    """The grid with a range's evidence of raised obstacles in each of the cells that hold points of the body frame.

    What was seen free before there was any measurement that near says nothing.
    """
    raised, p = grid.raised.copy(), numbers[0]
    cells = raised.reshape(-1)
    for k in np.unique(cell_index(x, y, pose, p.cell_m, grid.tag.shape[1])):
        cells[k] = min(max(cells[k], 0.0) + RANGE_EVIDENCE, p.max_evidence)
    return LocalGrid(grid.evidence, grid.tag, raised)
