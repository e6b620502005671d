"""Noise: of a whole image from a sample of its pixels, and flicker and motion of every pixel from frame to frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ndtorch.foreground.arrays import Array
from ndtorch.foreground.morphology import WORD, dilate, inside_row, majority_filter, mirrored, pack, row_of
from ndtorch.utils.jit import jit
from ndtorch.utils.selection import median

MEAN_SIZE, MEDIAN_SIZE = 0.798, 0.6745
"""Mean and median of the magnitude of a normal variable, in standard deviations."""
BLOCK_PX = 8
"""Scene cuts are detected by means of blocks of this side."""
BLOCK_CHANGE = 0.02
"""A block has changed if its mean differs by more than this from that of the frame before."""


class MotionLimits(NamedTuple):
    """Constants of `motion_and_noise`: seconds of a step, smallest change that is motion, threshold in deviations,
    share by which the flicker follows, and its largest outlier in its own sizes."""

    dt: float
    min_motion: float
    threshold_sigma: float
    learning_share: float
    outlier_limit: float


@jit
def subsample(image: Array) -> Array:
    """About every sixteenth pixel of `[h, w]`, counted from all four corners, `[n]`.

    The sample of a mirror image is the same, and so is everything estimated from it.
    """
    height, width = image.shape
    down, across = ((height + 1) // 2 + 3) // 4, ((width + 1) // 2 + 3) // 4
    some, n = np.empty(4 * down * across, image.dtype), 0
    for y in range(0, (height + 1) // 2, 4):
        for x in range(0, (width + 1) // 2, 4):
            some[n], some[n + 1] = image[y, x], image[y, width - 1 - x]
            some[n + 2], some[n + 3] = image[height - 1 - y, x], image[height - 1 - y, width - 1 - x]
            n += 4
    return some


@jit
def motion_and_noise(
    image: Array,
    blurred: Array,
    previous: Array,
    flicker: Array,
    static_time: Array,
    initialised: Array,
    unknown: int,
    candidates: Array,
    limits: MotionLimits,
) -> float:
    """Blur an image by a square, and update the static time and the flicker of every pixel.

    A pixel moves if it changes by more than the noise of the image and its own flicker, or, where the background is not
    initialised, if it is a foreground candidate. Its neighbours move with it.

    Args:
        image: this frame, and blurred: becomes it, blurred; previous: the blurred frame before, `[3, h, w]`.
        flicker, static_time: mean change from frame to frame, and seconds without motion, `[h, w]`; updated.
        initialised: above 0 where the background is known, `[h, w]`, and unknown: pixels where it is not.
        candidates: 1 for foreground candidates, `[h, w]` uint8.

    Returns:
        Share of the blocks that changed (see `scene_cut`), -1 if blocks do not divide the image.
    """
    _, height, width = blurred.shape
    kind = blurred.dtype.type
    change, changed_blocks = np.empty((height, width), blurred.dtype), 0
    across, whole = width // BLOCK_PX, height % BLOCK_PX == 0 and width % BLOCK_PX == 0
    sums, lines = np.zeros((3, width), kind), np.empty((3, width + 2), kind)
    least_sum, third = kind(BLOCK_CHANGE * BLOCK_PX * BLOCK_PX), kind(1 / 3)
    ninth = kind(1 / 9)
    for y in range(height):
        above, below = mirrored(y - 1, height), mirrored(y + 1, height)
        for x in range(width):
            for c in range(3):
                lines[c, x + 1] = image[c, above, x] + image[c, y, x] + image[c, below, x]
        for c in range(3):
            lines[c, 0], lines[c, width + 1] = lines[c, 2], lines[c, width - 1]
        for x in range(width):
            total = kind(0)
            for c in range(3):
                mean = (lines[c, x] + lines[c, x + 1] + lines[c, x + 2]) * ninth
                difference = mean - previous[c, y, x]
                blurred[c, y, x] = mean
                total += abs(difference)
                sums[c, x] += difference
            change[y, x] = total * third
        if whole and y % BLOCK_PX == BLOCK_PX - 1:
            for n in range(across):
                largest = max(block_sum(sums[0], n), block_sum(sums[1], n), block_sum(sums[2], n))
                changed_blocks += largest > least_sum
    some = subsample(change)
    noise = kind(median(some, some.shape[0]) / kind(MEDIAN_SIZE))
    over, margin = np.empty(width, np.uint8), 3
    inside = inside_row(width, margin)
    line = inside.shape[0]
    size = line * (height + 2 * margin)
    marks, moves = np.zeros(size, np.uint64), np.zeros(size, np.uint64)
    room = (np.empty(size, np.uint64), np.empty(size, np.uint64))
    for y in range(height):
        mark_motion(change[y], flicker[y], noise, limits, over)
        pack(over, row_of(marks, y, line, margin))
    majority_filter(marks, width, inside, margin, moves)
    if unknown:
        for y in range(height):
            pack(candidates[y], row_of(marks, y, line, margin))
        majority_filter(marks, width, inside, margin, room[0])
        for y in range(height):
            add_unknown(row_of(room[0], y, line, margin), initialised[y], row_of(moves, y, line, margin))
    dilate(moves, 3, inside, margin, room)
    for y in range(height):
        count_time(row_of(moves, y, line, margin), kind(limits.dt), static_time[y])
    return changed_blocks / (height // BLOCK_PX * across) if whole else -1.0


@jit
def block_sum(sums: Array, n: int) -> float:
    """Magnitude of the sum over block n, which begins anew."""
    total = sums.dtype.type(0)
    for x in range(n * BLOCK_PX, (n + 1) * BLOCK_PX):
        total += sums[x]
        sums[x] = 0
    return float(abs(total))


@jit
def mark_motion(change: Array, flicker: Array, noise: float, limits: MotionLimits, over: Array) -> None:
    """Mark changes above the noise in a row and update its flicker."""
    kind = change.dtype.type
    moved, spread, usual = kind(limits.min_motion), kind(limits.threshold_sigma), kind(1 / MEAN_SIZE)
    outlier, share, lowest = kind(limits.outlier_limit), kind(limits.learning_share), kind(noise)
    for x in range(over.shape[0]):
        here, own = change[x], flicker[x]
        least = max(lowest, own * usual)
        over[x] = here > max(moved, spread * least)
        flicker[x] = own + share * (min(here, outlier * least) - own)


@jit
def add_unknown(marks: Array, initialised: Array, moves: Array) -> None:
    """Add marks where the background is not initialised; both are rows of bits."""
    for x in range(initialised.shape[0]):
        moves[x // WORD] |= marks[x // WORD] & (np.uint64(initialised[x] == 0) << np.uint64(x % WORD))


@jit
def count_time(moves: Array, dt: float, static_time: Array) -> None:
    """Seconds without motion begin anew where a row of bits is marked."""
    for k in range(moves.shape[0]):
        part, word = static_time[WORD * k : WORD * (k + 1)], moves[k]
        for x in range(part.shape[0]):
            part[x] += dt
        for x in range(part.shape[0] if word else 0):
            if (word >> np.uint64(x)) & np.uint64(1):
                part[x] = 0
