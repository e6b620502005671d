"""Motion on a pyramid of images, at the scale that suits the displacement, averaged over fields."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.kernels.filters import Array
from ndtorch.kernels.pooled import add_row, over_columns
from ndtorch.utils.jit import jit


class ScaleNumbers(NamedTuple):
    """Time step, shares of the filters, and what the level is chosen by; `level` is -1 where it is chosen."""

    dt: float
    a_high: float
    a_low: float
    tau_low: float
    keep: float
    best: float
    level: int


@jit
def scale_motion(
    image: Array,
    before: tuple[tuple[Array, Array], tuple[Array, Array], tuple[Array, Array]],
    last: Array,
    change: float,
    slope: float,
    p: ScaleNumbers,
    rows: tuple[Array, Array, Array],
    columns: tuple[Array, Array, Array],
    margin: tuple[int, int],
    after: tuple[tuple[Array, Array], tuple[Array, Array], tuple[Array, Array]],
    coarse: Array,
    size: Array,
    motion: Array,
) -> tuple[int, float, float]:
    """`scale_step` and its mean over fields.

    Args:
        image: difference from the background, `[3, h, w]`.
        before, after: the filters of three levels, `[3, h / 2^k, w / 2^k]` each.
        last: the coarse image before; `coarse` becomes this one's.
        change, slope: of `ScaleState`.
        p: constants.
        rows, columns: weights of the fields' rows and columns on each level.
        margin: mirrored rows and columns around `size`, which becomes the largest magnitude of the colors.
        motion: becomes the means over fields, to the right and downward, `[2, R, C]`.

    Returns:
        The level, and `change` and `slope` after.
    """
    kind = image.dtype.type
    largest(image, margin, size)
    half = np.empty((3, image.shape[1] // 2, image.shape[2] // 2), image.dtype)
    halve(image, half)
    halve(half, coarse)
    changed, steep = kind(0), kind(0)
    for c in range(3):
        for y in range(coarse.shape[1]):
            for x in range(coarse.shape[2]):
                changed += (coarse[c, y, x] - last[c, y, x]) ** 2
            for x in range(1, coarse.shape[2]):
                steep += (coarse[c, y, x] - coarse[c, y, x - 1]) ** 2
            for x in range(coarse.shape[2] if y else 0):
                steep += (coarse[c, y, x] - coarse[c, y - 1, x]) ** 2
    change, slope = p.keep * change + changed, p.keep * slope + steep
    # What decays for minutes must not become a division of two roundings.
    if slope < 1e-9:
        change, slope = 0.0, 0.0
    level = p.level
    if level < 0:
        shift = 4 * math.sqrt(2 * change / slope) * (p.tau_low + p.dt) / p.dt if slope > 0 else 0.0
        level = (shift > p.best * math.sqrt(2)) + (shift > p.best * math.sqrt(8)) if shift > 0 else 1
    shares = (kind(p.a_high), kind(p.a_low))
    filter_level(image, before[0], shares, after[0], level == 0, rows[0], columns[0], motion)
    filter_level(half, before[1], shares, after[1], level == 1, rows[1], columns[1], motion)
    filter_level(coarse, before[2], shares, after[2], level == 2, rows[2], columns[2], motion)
    return level, change, slope


@jit
def largest(image: Array, margin: tuple[int, int], size: Array) -> None:
    """The largest magnitude of the colors, with mirrored margins."""
    _, height, width = image.shape
    top, left = margin
    for y in range(height):
        line = size[top + y]
        largest_of_row(image[0, y], image[1, y], image[2, y], line[left : left + width])
        for x in range(left):
            line[left - 1 - x] = line[left + 1 + x]
            line[left + width + x] = line[left + width - 2 - x]
    for y in range(top):
        size[top - 1 - y] = size[top + 1 + y]
        size[top + height + y] = size[top + height - 2 - y]


@jit
def largest_of_row(red: Array, green: Array, blue: Array, size: Array) -> None:
    """The largest magnitude of three colors of every pixel of a row."""
    for x in range(size.shape[0]):
        size[x] = max(max(abs(red[x]), abs(green[x])), abs(blue[x]))


@jit
def halve(image: Array, half: Array) -> None:
    """Means of two by two pixels."""
    share = half.dtype.type(0.25)
    for c in range(half.shape[0]):
        for y in range(half.shape[1]):
            one, two = image[c, 2 * y], image[c, 2 * y + 1]
            for x in range(half.shape[2]):
                half[c, y, x] = share * (one[2 * x] + one[2 * x + 1] + two[2 * x] + two[2 * x + 1])


@jit
def filter_level(
    image: Array,
    before: tuple[Array, Array],
    shares: tuple[float, float],
    after: tuple[Array, Array],
    wanted: bool,
    rows: Array,
    columns: Array,
    motion: Array,
) -> None:
    """`motion_step` of a level, and where it is the one that is wanted, its opponent motion over fields."""
    _, height, width = image.shape
    kind, half = image.dtype.type, image.dtype.type(0.5)
    highs = np.empty((2, 3, width), image.dtype)
    across, along = np.empty(width - 1, image.dtype), np.empty(width, image.dtype)
    left, sums = np.zeros((rows.shape[0], width - 1), image.dtype), np.zeros((rows.shape[0], width), image.dtype)
    for y in range(height):
        across[:] = 0
        along[:] = 0
        for c in range(3):
            high, late = highs[y % 2, c], after[1][c, y]
            filter_line(image[c, y], before[0][c, y], before[1][c, y], shares, after[0][c, y], late, high)
            if wanted:
                opponent(high[1:], late[:-1], high[:-1], late[1:], across)
                if y:
                    opponent(high, after[1][c, y - 1], highs[1 - y % 2, c], late, along)
        if wanted:
            add_row(across, rows, y, kind(1), left)
            if y:
                # What lies between neighbours, half on each of them.
                add_row(along, rows, y - 1, half, sums)
                add_row(along, rows, y, half, sums)
    if wanted:
        between = np.empty((columns.shape[0], width - 1), image.dtype)
        for c in range(columns.shape[0]):
            for x in range(width - 1):
                between[c, x] = half * (columns[c, x] + columns[c, x + 1])
        over_columns(left, between, motion[0])
        over_columns(sums, columns, motion[1])


@jit
def filter_line(
    image: Array,
    slow: Array,
    delayed: Array,
    shares: tuple[float, float],
    new_slow: Array,
    new_delayed: Array,
    high: Array,
) -> None:
    """`motion_step` of a row; numbers that have died away become zero, as in `filter_row`."""
    zero, tiny = image.dtype.type(0), image.dtype.type(1e-30)
    for x in range(image.shape[0]):
        mean = slow[x] + shares[0] * (image[x] - slow[x])
        fast = image[x] - mean
        last = delayed[x] + shares[1] * (fast - delayed[x])
        new_slow[x] = mean if abs(mean) > tiny else zero
        new_delayed[x] = last if abs(last) > tiny else zero
        high[x] = fast


@jit
def opponent(high: Array, late_before: Array, high_before: Array, late: Array, signed: Array) -> None:
    """Add `high late' - high' late` of two rows, or of a row and the same one pixel further on."""
    for x in range(signed.shape[0]):
        signed[x] += high[x] * late_before[x] - high_before[x] * late[x]
