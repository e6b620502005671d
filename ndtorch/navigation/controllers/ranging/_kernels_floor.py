"""Compiled: cells of floor, their image speed, whether both cameras see one floor there, and which look like floor."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ndtorch.navigation.stereo._kernels import Frames, cell_maxima, grey_row, is_finite
from ndtorch.utils.jit import jit

Array = Any
"""A NumPy array."""


class ViewNumbers(NamedTuple):
    """What `see_floor` looks at, in the rectangles of `FloorView.rects`, every so many columns.

    Attributes:
        rows: that both cameras compare, `[R]`.
        shift: pixels from a place of the left rectangle to that of the right one that sees the same floor, `[R]`.
        first_left, first_right: pixels from the left edge of the rectangles to that of their cells.
        columns: of a rectangle.
        wide, tall: columns and rows of a cell; `bands` and `blocks` are how many there are.
        every: only every so many columns are read.
        a: share of the high-pass.
        scale: from its output to the units of the thresholds of [A].
        min_correlation, min_texture: from which on it is one floor, and the least mean square of the changes from pixel
            to pixel for that.
        min_change, max_gain, dark: of `illumination_gain`.
    """

    rows: Array
    shift: Array
    first_left: int
    first_right: int
    columns: int
    wide: int
    tall: int
    bands: int
    blocks: int
    every: int
    a: float
    scale: float
    min_correlation: float
    min_texture: float
    min_change: float
    max_gain: float
    dark: float


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


class FloorNumbers(NamedTuple):
    """`FloorParams` for one time step.

    Attributes:
        flow: squared image speed at 1 m/s, pixels a step, `[bands]`.
        profile: first guess of the level over that of near floor, `[bands]`.
        full: share of its level that floor shows at full speed, `[bands]`.
        yaw: focal length times the time step.
        saturation: -1 / `FloorParams.saturation`.
        tolerance: logarithm.
        clear: how many times the noise an output must be.
        standing, learning: time steps until the car begins, and until it knows its floor.
        learn_share, share: of a step, while it learns and after that.
        upright, trusted: as in `FloorParams`.
        floor_weight, end_weight: evidence of floor, and of its end.
        least_noise: output that the 256 levels of an image alone can make.
    """

    flow: Array
    profile: Array
    full: Array
    yaw: float
    saturation: float
    tolerance: float
    clear: float
    standing: int
    learning: int
    learn_share: float
    share: float
    upright: int
    trusted: float
    floor_weight: float
    end_weight: float
    least_noise: float


LEAST, MOVING, STILL, NOISE_SHARE = 1e-6, 0.1, 0.001, 0.3
"""Smallest output that counts; m/s from which the floor is learned, and below which the wheels stand: a car that goes
from forward to backward passes through 0 while its image still moves; and share of a step when noise is measured."""


@jit
def see_floor(frames: Frames, settle: bool, low: Array, view: ViewNumbers, new_low: Array, cells: Array) -> float:
    """Image speed and stereo match of every cell of floor; returns the largest change of a pixel.

    Args:
        settle: the filters start at rest on this frame.
        low, new_low: states of the filters, `[2, h, w]`.
        cells: becomes `[4, bands, blocks]`, nearest band and outermost block first: image speeds of the left and the
            right camera, then 1 where both see one floor, 0 where they do not, -1 where only one sees the cell.
    """
    v = view
    grey, wider = np.empty(new_low.shape, np.float32), np.empty((2, v.rows.size, v.columns), np.float32)
    grey_fields(frames, v, grey, wider)
    match_cells(wider, v, cells[2:])
    gain = 1.0 if settle else illumination_gain(grey, low, v)
    found = np.empty((2, v.bands, v.blocks), np.float32)
    peak = cell_maxima(grey, settle, low, gain, v.a, new_low, found)
    for eye in range(2):
        for band in range(v.bands):
            for block in range(v.blocks):
                # The nearest band is the first, and the outermost block too.
                value = found[eye, v.bands - 1 - band, v.blocks - 1 - block if eye else block]
                cells[eye, band, block] = value * np.float32(v.scale)
    return peak if frames.left.itemsize == 1 or (is_finite(grey) and is_finite(wider)) else np.nan


@jit
def grey_fields(frames: Frames, view: ViewNumbers, grey: Array, wider: Array) -> None:
    """Every row of pixels once: the cells into `grey` `[2, h, w]`, and the rows to compare into `wider` `[2, R, w]`."""
    v = view
    for eye in range(2):
        frame, first = (frames.right, v.first_right) if eye else (frames.left, v.first_left)
        top, left, r = frames.tops[eye], frames.lefts[eye], 0
        for y in range(grey.shape[1]):
            if r < v.rows.size and v.rows[r] == y:
                grey_row(frame, frames.interleaved, top + y, left, v.every, frames.scale, wider[eye, r])
                copy_row(wider[eye, r, first:], grey[eye, y])
                r += 1
            else:
                begin = left + v.every * first
                grey_row(frame, frames.interleaved, top + y, begin, v.every, frames.scale, grey[eye, y])


@jit
def copy_row(row: Array, part: Array) -> None:
    for x in range(part.shape[0]):
        part[x] = row[x]


@jit
def illumination_gain(grey: Array, low: Array, view: ViewNumbers) -> float:
    """How much brighter the light is than in the state of the filters: lamps that flicker are not motion.

    The top rows of the cells of both cameras are compared with themselves, and their median counts. So what comes into
    view does not matter, as long as it fills less than half of the cells.

    Args:
        grey: the cells now, `[2, h, w]`; `low` is the state.
    """
    bands, blocks, kind = view.bands, view.blocks, np.float32
    tall, wide = low.shape[1] // bands, low.shape[2] // blocks
    dark, pixels, before = kind(view.dark) * kind(wide), grey.reshape(-1), low.reshape(-1)
    ratios, total = np.empty(2 * bands * blocks, np.float32), kind(0)
    for eye in range(2):
        for band in range(bands):
            for block in range(blocks):
                now, was = kind(0), kind(0)
                start = np.uintp((eye * low.shape[1] + tall * band) * low.shape[2] + block * wide)
                for x in range(wide):
                    now += pixels[start + np.uintp(x)]
                    was += before[start + np.uintp(x)]
                ratio = max(now, dark) / max(was, dark)
                ratios[(eye * bands + band) * blocks + block] = ratio
                total += ratio
    # NaN has no place in an order; it is reported by the maxima of the cells.
    if not math.isfinite(total):
        return 1.0
    gain = float(lower_median(ratios))
    if abs(gain - 1) > view.min_change and 1 / view.max_gain < gain < view.max_gain:
        return gain
    return 1.0


@jit
def match_cells(grey: Array, view: ViewNumbers, found: Array) -> None:
    """Whether each cell, with the one behind it, is one floor: 1; -1 where the other camera does not see it, else 0.

    Floor is seen `focal * baseline / depth` columns apart, fewer in every row that is farther up; a wall is seen as far
    apart in all rows as its foot. So a cell of floor looks alike in both images along these lines, and a wall does not.
    The changes from pixel to pixel are compared, less their means: neither light nor the foot of a wall, which lies in
    one row of both images, makes rows alike.

    Args:
        grey: the rows that are compared, `[2, R, w]`.
        found: `[2, bands, blocks]`, nearest band and outermost block first.
    """
    rows, shift, wide, tall = view.rows, view.shift, view.wide, view.tall
    _, bands, blocks = found.shape
    width = grey.shape[2]
    kind, n = np.float32, wide - 1
    alike, least = view.min_correlation, view.min_texture
    each = kind(1) / kind(n)
    pixels = grey.reshape(-1)
    # Of the rows of one band so far, in every column: long loops over neighbours. Blocks are summed up once a band.
    columns = np.zeros((2, 3, blocks * wide), np.float32)
    sums_of_rows = columns.reshape(-1)
    sums = np.zeros((2, bands + 1, blocks, 3), np.float32)
    seen = np.zeros((2, bands + 1, blocks), np.int64)
    for r in range(rows.size):
        band = max(0, bands - 1 - rows[r] // tall)
        for eye in range(2):
            away, first = (-shift[r], view.first_right) if eye else (shift[r], view.first_left)
            # Blocks that are in both rows: from the first that begins there up to the first that ends outside.
            begin = max(0, -((first + away) // wide))
            end = min(blocks, (width - 1 - n - first - away) // wide + 1)
            if begin >= end:
                continue
            at = np.uintp((eye * rows.size + r) * width + first + wide * begin)
            there = np.uintp(((1 - eye) * rows.size + r) * width + first + away + wide * begin)
            for k in range(begin, end):
                x = np.uintp((k - begin) * wide)
                # Changes add up to the difference of the last pixel and the first.
                mine = pixels[at + x + np.uintp(n)] - pixels[at + x]
                his = pixels[there + x + np.uintp(n)] - pixels[there + x]
                place = blocks - 1 - k if eye else k
                of_all = mine * each
                sums[eye, band, place, 0] -= of_all * his
                sums[eye, band, place, 1] -= of_all * mine
                sums[eye, band, place, 2] -= his * his * each
                seen[eye, band, place] += 1
            add_products(pixels, at, there, columns[eye], np.uintp(wide * begin), wide * (end - begin) - 1)
        if r + 1 == rows.size or band != max(0, bands - 1 - rows[r + 1] // tall):
            for eye in range(2):
                for k in range(blocks):
                    place = blocks - 1 - k if eye else k
                    add_up(columns[eye], np.uintp(wide * k), n, sums[eye, band, place])
            for k in range(columns.size):
                sums_of_rows[k] = 0
    step = 2 if rows.size < 2 else rows[1] - rows[0]
    for eye in range(2):
        for band in range(bands):
            for k in range(blocks):
                compared = seen[eye, band, k] + seen[eye, band + 1, k]
                product = sums[eye, band, k, 0] + sums[eye, band + 1, k, 0]
                square = sums[eye, band, k, 1] + sums[eye, band + 1, k, 1]
                other = sums[eye, band, k, 2] + sums[eye, band + 1, k, 2]
                enough = kind(least) * kind((wide - 1) * compared)
                same = product > kind(alike) * kind(math.sqrt(max(square, kind(0)) * max(other, kind(0))))
                verdict = kind(1) if same and min(square, other) > enough else kind(0)
                found[eye, band, k] = kind(-1) if 2 * step * compared < tall else verdict


@jit
def add_products(pixels: Array, at: Any, there: Any, sums: Array, column: Any, size: int) -> None:
    """Products of so many changes from pixel to pixel in two rows, and their squares, are added to sums `[3, n]`."""
    for x in range(size):
        k = np.uintp(x)
        mine = pixels[at + k + np.uintp(1)] - pixels[at + k]
        his = pixels[there + k + np.uintp(1)] - pixels[there + k]
        sums[0, column + k] += mine * his
        sums[1, column + k] += mine * mine
        sums[2, column + k] += his * his


@jit
def add_up(columns: Array, start: Any, size: int, sums: Array) -> None:
    """Add so many columns of products `[3, ...]` to their sums `[3]`."""
    kind = sums.dtype.type
    product, square, other = kind(0), kind(0), kind(0)
    for x in range(size):
        k = start + np.uintp(x)
        product += columns[0, k]
        square += columns[1, k]
        other += columns[2, k]
    sums[0] += product
    sums[1] += square
    sums[2] += other


@jit(exact=True)
def floor_step(
    cells: Array, driven: tuple[float, float], state: FloorState, numbers: FloorNumbers, evidence: Array
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
        cells: of `see_floor`, `[4, bands, blocks]`, or the first two of it.
        driven: speed, m/s, and curvature, 1/m, since the last frame.
        evidence: becomes what each cell adds to the grid, `[2, bands, blocks]`.
    """
    p, level, age = numbers, state.level, state.age + 1
    kind, noise = np.float32, np.float32(state.noise)
    clear, upright = p.clear, p.upright
    eyes, bands, blocks = cells.shape
    speed, turning = abs(kind(driven[0])), kind(driven[1]) * kind(p.yaw)
    learning, new_level = age <= p.learning, np.empty_like(level)
    shape, known, gained = np.empty(bands, np.float32), np.empty(bands, np.bool_), np.empty(bands, np.float32)
    for b in range(bands):
        passing = kind(math.sqrt(p.flow[b] + turning * turning)) * speed
        shape[b] = -math.expm1(passing * kind(p.saturation))
        gained[b] = kind(0)
        known[b] = level[b] * shape[b] > noise * kind(clear) and not learning
    excess = np.zeros((bands, blocks), np.float32)
    floor = np.zeros((bands, blocks), np.bool_)
    # As `agree`.
    one, seen_by_both = 0, 0
    for eye in range(2, eyes):
        for b in range(bands):
            for k in range(blocks):
                one += cells[eye, b, k] > 0
                seen_by_both += cells[eye, b, k] >= 0
    trusted = one > 0 and kind(one) >= kind(p.trusted) * kind(seen_by_both)
    for eye in range(2):
        mistaken: Any = False
        for b in range(bands):
            expected = max(level[b] * shape[b], kind(LEAST))
            for k in range(blocks):
                if known[b]:
                    excess[b, k] = kind(math.log(max(cells[eye, b, k], kind(LEAST)) / expected))
                    floor[b, k] = abs(excess[b, k]) < kind(p.tolerance)
                    mistaken = mistaken or (eyes == 4 and not floor[b, k] and cells[eye + 2, b, k] > 0)
        beside = bands
        for k in range(blocks - 1, -1, -1):
            reached: Any = True
            end = bands
            # As `stands`; of these cells only the nearest matters, since nothing behind it is reached.
            foot, none, b = bands, 0, bands - 1
            while trusted and b >= 0 and cells[eye + 2, b, k] <= 0:
                if cells[eye + 2, b, k] == 0:
                    none += 1
                    foot = b if none >= upright else foot
                b -= 1
            for b in range(bands):
                both = cells[eye + 2, b, k] if eyes == 4 else kind(0)
                looks = (floor[b, k] and b != foot) or (known[b] and both > 0)
                goes_on = looks or (mistaken and both < 0)
                seen = reached and looks and not (trusted and both < 0 and b >= beside)
                ends = reached and known[b] and not goes_on
                end = b if ends else end
                evidence[eye, b, k] = kind(p.end_weight) if ends else -kind(p.floor_weight) if seen else kind(0)
                if seen and floor[b, k]:
                    gained[b] += excess[b, k]
                reached = reached and goes_on
            beside = end
    for b in range(bands):
        new_level[b] = level[b] * kind(math.exp(gained[b] * kind(p.share)))
    if learning:
        for b in range(bands):
            new_level[b] = level[b]
        if age > p.standing and speed > kind(MOVING):
            learn(cells, shape, level, p.profile, kind(p.learn_share), new_level)
    if speed < kind(STILL):
        values = np.empty(2 * bands * blocks, np.float32)
        for k in range(values.size):
            values[k] = cells[k // (bands * blocks), k // blocks % bands, k % blocks]
        middle = lower_median(values)
        noise = noise + kind(NOISE_SHARE) * (middle - noise)
    return FloorState(new_level, np.float64(noise), age)


@jit(exact=True)
def learn(cells: Array, shape: Array, level: Array, profile: Array, share: float, new_level: Array) -> None:
    """At the start most of the nearest cells are floor: their median is its level."""
    near = max(1, cells.shape[1] * 2 // 5)
    blocks = cells.shape[2]
    steady = np.empty(2 * near * blocks, np.float32)
    for k in range(len(steady)):
        b = k // blocks % near
        steady[k] = cells[k // (near * blocks), b, k % blocks] / max(shape[b], np.float32(MOVING))
    middle = lower_median(steady)
    for b in range(len(level)):
        guess = middle * profile[b]
        new_level[b] = level[b] + share * (guess - level[b]) if level[b] > 0 else guess


@jit
def lower_median(values: Array) -> float:
    """As `torch.median`: of an even number of values the lower one in the middle. It moves the values [Hoare 1961].

    `np.partition` takes seven seconds to compile.
    """
    first, last = 0, values.shape[0] - 1
    middle = last // 2
    while first < last:
        pivot, low, high = values[middle], first, last
        while low <= high:
            while values[low] < pivot:
                low += 1
            while pivot < values[high]:
                high -= 1
            if low <= high:
                values[low], values[high] = values[high], values[low]
                low, high = low + 1, high - 1
        if high < middle:
            first = low
        if middle < low:
            last = high
    value: float = values[middle]
    return value


@jit(exact=True)
def known_share(floor: FloorState, numbers: FloorNumbers) -> float:
    """Share of the bands in which floor would be told from noise at full speed; 1 while it is learned."""
    if floor.age <= numbers.learning:
        return 1.0
    kind, known, bands = np.float32, 0, floor.level.shape[0]
    noise = kind(max(floor.noise, numbers.least_noise)) * kind(numbers.clear)
    for band in range(bands):
        known += floor.level[band] * numbers.full[band] > noise
    share: float = known / bands
    return share


@jit
def speed_share(share: float) -> float:
    """How much of its speed a car may have that knows such a share of its floor."""
    return min(max((share - STOP_SHARE) / (FULL_SHARE - STOP_SHARE), 0.0), 1.0)


STOP_SHARE, FULL_SHARE = 0.25, 0.75
"""Shares of the bands of floor that are told from noise up to which the car stands, and from which on it is fast."""
