"""Cells of floor: where they lie, their image speed, whether both cameras see one floor, and which look like it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.errors import InputError
from ndtorch.navigation.controllers.ranging.params import FloorParams
from ndtorch.navigation.stereo._kernels import Array, Frames, cell_maxima, grey_fields
from ndtorch.navigation.stereo.rig import Rect, StereoRig
from ndtorch.utils.jit import jit
from ndtorch.vision.nondirectional import SPEED_SCALE

INNER, OUTER = math.radians(-10.5), math.radians(29.2)
"""Directions between which the patches lie, outward of the axis of their camera: the two overlap ahead of the car."""

EVERY = 2
"""Only every second column of a patch is read, and every second row compared with the other camera's."""

MIN_CHANGE, MAX_GAIN, DARK = 0.01, 2.0, 0.01
"""Illumination: changes up to the first ratio are left alone, as much comes from texture that moves past; no lamp
changes by more than the second factor from one frame to the next; means below the third say nothing of the light."""

MIN_CORRELATION, MIN_TEXTURE = 0.7, 0.002
"""One floor has this correlation of both images, and changes from pixel to pixel of this ratio of white, at least."""

SATURATION_PX = 1.2
"""Image speed, pixels a step, at which the output of floor reaches 63 % of its largest."""

STANDING_S, LEARNING_S, ADAPTATION_S = 0.1, 0.4, 5.0
"""The car stands at the start, to measure the noise of the cameras, drives straight on to learn what its floor looks
like, and learns after that with this time constant, from cells that look like floor."""

MIN_SIGNAL = 1.5
"""Floor is unknown where its low threshold is less than this many times the noise."""

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


class FloorView(NamedTuple):
    """Geometry of the cells.

    Attributes:
        rects: that are read of the left and the right image: the cells, and inward of them what the other eye
            needs to see the floor of its own cells a second time.
        firsts: columns that are read before those of the cells.
        shape: of what is read, `[2, h, w]`, and of its cells, `[2, h, w]`.
        bands: how many there are, no more than rows.
        depth: of the middle of each band ahead of the cameras, m, `[bands]`, nearest first.
        x, y: floor at the middle of each cell in the body frame, m, `[2, bands, blocks]`, left image first.
        sweep: image speed of the floor in each band when driving 1 m/s, pixels a second, `[bands]`.
        shift: columns that are read, from a place of the left rectangle to that of the right one that sees the same
            floor, in every row, `[h]`.
    """

    rects: tuple[Rect, Rect]
    firsts: tuple[int, int]
    shape: tuple[tuple[int, int, int], tuple[int, int, int]]
    bands: int
    depth: Array
    x: Array
    y: Array
    sweep: Array
    shift: Array


def floor_view(rig: StereoRig, params: FloorParams) -> FloorView:
    """Lay the cells out: whole pixels, equal cells, mirror images of each other.

    Raises:
        InputError: cells that do not fit into the frame.
    """
    p, (middle, level), height = params, rig.center, rig.camera_height
    cos, sin = math.cos(rig.pitch), math.sin(rig.pitch)
    near, far = (
        level + rig.focal * (height * cos - depth * sin) / (depth * cos + height * sin) for depth in (p.near_m, p.far_m)
    )
    bottom = math.floor(near) + 1
    bands = min(p.bands, max(2, bottom - math.ceil(far)))
    tall = (bottom - math.ceil(far)) // bands
    # Where the axes do not meet the middle of the frames, mirror images lie so many columns farther to the right.
    aside_px = round(2 * middle) - (rig.width - 1)
    left = max(0, aside_px, math.ceil(middle - rig.focal * math.tan(OUTER)))
    wide = (math.floor(middle - rig.focal * math.tan(INNER)) + 1 - left) // (p.blocks * EVERY) * EVERY
    top, right, end = bottom - tall * bands, left + wide * p.blocks, rig.width + min(aside_px, 0)
    if tall < 1 or wide < 1 or top < 0 or bottom > rig.height or right > end:
        raise InputError(
            f"{bands} bands by {p.blocks} blocks of floor {p.near_m:g}-{p.far_m:g} m ahead do not fit into "
            f"{rig.width}x{rig.height} frames{rig.floor_hint(p.near_m)}; controller 'published' needs less floor, "
            "and StereoRanging none"
        )
    mirror = rig.width + aside_px
    end -= (end - right) % EVERY
    rects = Rect(top, bottom, left, end), Rect(top, bottom, mirror - end, mirror - left)
    rows = bottom - 0.5 - tall * (np.arange(bands) + 0.5)
    down = (rows - level) / rig.focal
    # The ray through the row: (cos - down sin) ahead for every (sin + down cos) down.
    depth = height * (cos - down * sin) / (sin + down * cos)
    columns = left - 0.5 + wide * (np.arange(p.blocks) + 0.5)
    # Columns go with y over the depth along the axis, which a pitch makes differ from the way along the floor.
    along = depth * cos + height * sin
    aside = rig.baseline / 2 + along[:, None] * (middle - columns) / rig.focal
    x = np.broadcast_to((rig.forward + depth)[:, None], aside.shape)
    below = (np.arange(top, bottom) - level) / rig.focal
    disparity = rig.focal * rig.baseline / (height / (sin + below * cos))
    cells = (2, bottom - top, wide * p.blocks // EVERY)
    return FloorView(
        rects,
        (0, (end - right) // EVERY),
        ((2, bottom - top, (end - left) // EVERY), cells),
        bands,
        depth,
        np.stack((x, x)),
        np.stack((aside, -aside)),
        rig.focal * height / along**2,
        np.rint((left - rects[1].left - disparity) / EVERY).astype(np.int64),
    )


@jit
def see_floor(
    frames: Frames,
    settle: bool,
    low: Array,
    a: float,
    firsts: tuple[int, int],
    shift: Array,
    grey: Array,
    new_low: Array,
    cells: Array,
) -> float:
    """Image speed and stereo match of every cell of floor; returns the largest change of a pixel.

    Args:
        settle: the filters start at rest on this frame.
        low, new_low: states of the filters, `[2, h, w]`.
        a: ratio of the high-pass.
        firsts, shift: of `FloorView`.
        grey: becomes what is read, `[2, h, w]`.
        cells: becomes `[4, bands, blocks]`, nearest band and outermost block first: image speeds of the left and the
            right camera, then 1 where both see one floor, 0 where they do not, -1 where only one sees the cell.
    """
    _, bands, blocks = cells.shape
    finite, own = grey_fields(frames, np.intp(EVERY), grey), np.empty(low.shape, np.float32)
    for eye in range(2):
        own[eye] = grey[eye, :, firsts[eye] : firsts[eye] + low.shape[2]]
    match_cells(grey, firsts, shift, low.shape[2] // blocks, cells[2:])
    before = low if settle else low * np.float32(illumination_gain(own, low, bands, blocks))
    maxima = np.empty((2, bands, blocks), np.float32)
    peak = cell_maxima(own, settle, before, a, new_low, maxima)
    cells[0] = maxima[0, ::-1] * np.float32(SPEED_SCALE)
    cells[1] = maxima[1, ::-1, ::-1] * np.float32(SPEED_SCALE)
    return peak if finite else np.nan


@jit
def illumination_gain(grey: Array, low: Array, bands: int, blocks: int) -> float:
    """How much brighter the light is than in the state of the filters: lamps that flicker are not motion.

    The top rows of the cells of both cameras are compared with themselves, and their median counts. So what comes into
    view does not matter, as long as it fills less than half of the cells.

    Args:
        grey: the cells now, `[2, h, w]`; `low` is the state.
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

    Args:
        grey: what is read, `[2, h, w]`.
        wide: columns of a cell.
        common: `[2, bands, blocks]`, nearest band and outermost block first.
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
    """Products of the changes from pixel to pixel of two rows less their means, and their squares, are added."""
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
    """As `torch.median`: of an even number of values the lower one in the middle."""
    return float(np.sort(values)[(values.size - 1) // 2])


class FloorState(NamedTuple):
    """What one car has learned of the floor.

    Attributes:
        level: output of fast moving floor, `[bands]`; 0 while nothing is learned.
        noise: output while standing.
        age: time steps since the start.
    """

    level: Array
    noise: float
    age: int


class FloorTables(NamedTuple):
    """What `floor_step` needs of a view and a time step.

    Attributes:
        flow: squared image speed at 1 m/s, pixels a step, `[bands]`.
        profile: first guess of the level over that of near floor, `[bands]`.
        full: ratio of its level that floor shows at full speed, `[bands]`.
        yaw: focal length times the time step.
        tolerance: of `FloorParams`.
        standing, learning: time steps until the car begins, and until it knows its floor.
        adaptation: ratio of a step in which each cell teaches the level.
    """

    flow: Array
    profile: Array
    full: Array
    yaw: float
    tolerance: float
    standing: int
    learning: int
    adaptation: float


def floor_tables(rig: StereoRig, params: FloorParams, speed: float, view: FloorView, dt: float) -> FloorTables:
    """The tables for a car that drives at this speed, m/s."""
    standing = round(STANDING_S / dt)
    return FloorTables(
        flow=((view.sweep * dt) ** 2).astype(np.float32),
        # Far floor is finer than a pixel and gives less; before its own level is learned this is a fair guess.
        profile=(1.0 - 0.5 * (view.depth - 1.2)).clip(0.3, 1.0).astype(np.float32),
        full=(-np.expm1(-view.sweep * dt * speed / SATURATION_PX)).astype(np.float32),
        yaw=rig.focal * dt,
        tolerance=float(params.tolerance_ratio),
        standing=standing,
        learning=standing + max(1, round(LEARNING_S / dt)),
        adaptation=dt / ADAPTATION_S / (2 * params.blocks),
    )


@jit(exact=True)
def floor_step(
    cells: Array, driven: tuple[float, float], state: FloorState, tables: FloorTables, evidence: Array
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
    t, level, noise, age = tables, state.level, state.noise, state.age + 1
    _, bands, blocks = cells.shape
    speed, turning, learning = abs(driven[0]), driven[1] * t.yaw, age <= t.learning
    shape, known, gained = np.empty(bands), np.empty(bands, np.bool_), np.zeros(bands)
    for b in range(bands):
        shape[b] = -math.expm1(-math.sqrt(t.flow[b] + turning * turning) * speed / SATURATION_PX)
        known[b] = level[b] * shape[b] > noise * MIN_SIGNAL * t.tolerance and not learning
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
                    floor[b, k] = abs(excess[b, k]) < math.log(t.tolerance)
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
    new_level = level * np.exp(gained * t.adaptation).astype(np.float32)
    if learning and age > t.standing and speed > MOVING:
        # At the start most of the nearest cells are floor: their median is its level.
        near = max(1, bands * 2 // 5)
        steady = cells[:2, :near].copy()
        for b in range(near):
            steady[:, b] /= max(shape[b], MOVING)
        guess, ratio = lower_median(steady.reshape(-1)) * t.profile, 2 / (t.learning - t.standing)
        for b in range(bands):
            new_level[b] = level[b] + ratio * (guess[b] - level[b]) if level[b] > 0 else guess[b]
    if speed < STILL:
        noise += NOISE_RATIO * (lower_median(cells[:2].copy().reshape(-1)) - noise)
    return FloorState(new_level, noise, age)


@jit(exact=True)
def known_ratio(floor: FloorState, tables: FloorTables) -> float:
    """Ratio of the bands in which floor would be told from noise at full speed; 1 while it is learned."""
    least = max(floor.noise, MIN_NOISE) * MIN_SIGNAL * tables.tolerance
    known = (floor.level * tables.full > least).sum() / floor.level.shape[0]
    return 1.0 if floor.age <= tables.learning else float(known)
