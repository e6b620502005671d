"""One pass over silhouettes: motion and color of each, and what their orientation is told from."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.any_of import any_of
from ndtorch.utils.jit import jit
from ndtorch.vision._kernels_row import Array


@jit
def field_sums(
    picture: Array,
    ground: Array,
    silhouettes: Array,
    slow: Array,
    delayed: Array,
    a_high: float,
    a_low: float,
    strongest: Array,
    sums: Array,
) -> None:
    """The first part of `FigureSignals.forward`, at half the height and width.

    Args:
        picture, ground: `[3, h, w]`.
        silhouettes: `[h, w]` int32.
        slow, delayed: `MotionState`; become that after the step, `[3, h / 2, w / 2]`.
        a_high, a_low: shares of its filters.
        strongest: becomes the largest difference from the ground among the colors, `[h / 2, w / 2]`.
        sums: becomes pixels, motion across and along, and red, green and blue of each field, `[fields, 6]`
            float64: roots are taken of what is left of motion both ways.
    """
    kind = picture.dtype.type
    _, height, width = slow.shape
    fields = sums.shape[0]
    quarter, shares = kind(0.25), (a_high, a_low)
    high, color = np.empty((3, height, width), picture.dtype), np.empty(3, picture.dtype)
    upper, lower = np.empty(2 * width, picture.dtype), np.empty(2 * width, picture.dtype)
    seen, some = np.empty(width, picture.dtype), np.empty(height, np.bool_)
    for n in range(fields):
        for k in range(6):
            sums[n, k] = 0
    for y in range(height):
        # Mostly no silhouette is there, and the filters only fade.
        some[y] = any_of(silhouettes[2 * y]) or any_of(silhouettes[2 * y + 1])
        for x in range(width):
            strongest[y, x] = seen[x] = 0
        for c in range(3):
            if some[y]:
                differ(picture[c, 2 * y], ground[c, 2 * y], silhouettes[2 * y], upper)
                differ(picture[c, 2 * y + 1], ground[c, 2 * y + 1], silhouettes[2 * y + 1], lower)
                halve(upper, lower, quarter, seen)
            pass_high(seen, shares, slow[c, y], delayed[c, y], high[c, y], strongest[y])
    for y in range(height):
        for x in range(width if some[y] else 0):
            top = max(silhouettes[2 * y, 2 * x], silhouettes[2 * y, 2 * x + 1])
            name = max(top, max(silhouettes[2 * y + 1, 2 * x], silhouettes[2 * y + 1, 2 * x + 1]))
            if name <= 0:
                continue
            n = (name - 1) % fields
            across, along, grey = 0.0, 0.0, kind(0)
            for c in range(3):
                here, late = np.float64(high[c, y, x]), np.float64(delayed[c, y, x])
                if x + 1 < width:
                    across += high[c, y, x + 1] * late - here * delayed[c, y, x + 1]
                if x:
                    across += here * delayed[c, y, x - 1] - high[c, y, x - 1] * late
                if y + 1 < height:
                    along += high[c, y + 1, x] * late - here * delayed[c, y + 1, x]
                if y:
                    along += here * delayed[c, y - 1, x] - high[c, y - 1, x] * late
                color[c] = quarter * (
                    (picture[c, 2 * y, 2 * x] + picture[c, 2 * y, 2 * x + 1])
                    + (picture[c, 2 * y + 1, 2 * x] + picture[c, 2 * y + 1, 2 * x + 1])
                )
                grey += color[c] / 3
            sums[n, 0] += 1
            # What two neighbors make of a motion belongs to both by half.
            sums[n, 1] += 0.5 * across
            sums[n, 2] += 0.5 * along
            for c in range(3):
                sums[n, 3 + c] += max(color[c] - grey, kind(0))


@jit
def differ(picture: Array, ground: Array, silhouettes: Array, found: Array) -> None:
    """How far silhouettes differ from the ground in one color of one row; 0 elsewhere."""
    none = found.dtype.type(0)
    for x in range(found.shape[0]):
        apart_by = picture[x] - ground[x]
        found[x] = apart_by if silhouettes[x] > 0 else none


@jit(exact=True)
def halve(upper: Array, lower: Array, quarter: float, found: Array) -> None:
    """Means of blocks of two by two pixels. Row by row: that of a mirror image is the same to the last digit."""
    for x in range(found.shape[0]):
        found[x] = ((upper[2 * x] + upper[2 * x + 1]) + (lower[2 * x] + lower[2 * x + 1])) * quarter


@jit
def pass_high(
    seen: Array, shares: tuple[float, float], slow: Array, delayed: Array, high: Array, strongest: Array
) -> None:
    """High-pass and delay of one color of one row, and the largest value of the colors so far."""
    kind = high.dtype.type
    share, lag, tiny, none = kind(shares[0]), kind(shares[1]), kind(1e-30), kind(0)
    for x in range(high.shape[0]):
        here, before, ago = seen[x], slow[x], delayed[x]
        mean = before + share * (here - before)
        fast = here - mean
        late = ago + lag * (fast - ago)
        high[x] = fast
        slow[x] = mean if abs(mean) > tiny else none
        delayed[x] = late if abs(late) > tiny else none
        strongest[x] = max(strongest[x], abs(here))
