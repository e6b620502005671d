"""One pass over silhouettes: motion and color of each, and what their orientation is told from."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array


def field_sums(
    picture: Array,
    ground: Array,
    silhouettes: Array,
    slow: Array,
    delayed: Array,
    a_high: float,
    a_low: float,
    new_slow: Array,
    new_delayed: Array,
    strongest: Array,
    sums: Array,
) -> None:
    """The first part of `FigureSignals.forward`, at half the height and width.

    Args:
        picture, ground: `[3, h, w]`.
        silhouettes: `[h, w]` int32.
        slow, delayed, new_slow, new_delayed: `MotionState` before and after, `[3, h / 2, w / 2]`.
        a_high, a_low: shares of its filters.
        strongest: becomes the largest difference from the ground among the colors, `[h / 2, w / 2]`.
        sums: becomes pixels, motion across and along, and red, green and blue of each field, `[fields, 6]`
            float64: roots are taken of what is left of motion both ways.
    """
    kind = picture.dtype.type
    _, height, width = slow.shape
    fields = sums.shape[0]
    quarter, share, lag, tiny = kind(0.25), kind(a_high), kind(a_low), kind(1e-30)
    high, color = np.empty((3, height, width), picture.dtype), np.empty(3, picture.dtype)
    for n in range(fields):
        for k in range(6):
            sums[n, k] = 0
    for y in range(height):
        for x in range(width):
            most = kind(0)
            for c in range(3):
                total = kind(0)
                # Row by row: the sum of a mirror image is the same to the last digit.
                for j in range(2):
                    line = kind(0)
                    for i in range(2):
                        if silhouettes[2 * y + j, 2 * x + i] > 0:
                            line += picture[c, 2 * y + j, 2 * x + i] - ground[c, 2 * y + j, 2 * x + i]
                    total += line
                seen = total * quarter
                most = max(most, abs(seen))
                mean = slow[c, y, x] + share * (seen - slow[c, y, x])
                fast = seen - mean
                late = delayed[c, y, x] + lag * (fast - delayed[c, y, x])
                high[c, y, x] = fast
                new_slow[c, y, x] = mean if abs(mean) > tiny else kind(0)
                new_delayed[c, y, x] = late if abs(late) > tiny else kind(0)
            strongest[y, x] = most
    for y in range(height):
        for x in range(width):
            top = max(silhouettes[2 * y, 2 * x], silhouettes[2 * y, 2 * x + 1])
            name = max(top, max(silhouettes[2 * y + 1, 2 * x], silhouettes[2 * y + 1, 2 * x + 1]))
            if name <= 0:
                continue
            n = (name - 1) % fields
            across, along, grey = 0.0, 0.0, kind(0)
            for c in range(3):
                here, late = np.float64(high[c, y, x]), np.float64(new_delayed[c, y, x])
                if x + 1 < width:
                    across += high[c, y, x + 1] * late - here * new_delayed[c, y, x + 1]
                if x:
                    across += here * new_delayed[c, y, x - 1] - high[c, y, x - 1] * late
                if y + 1 < height:
                    along += high[c, y + 1, x] * late - here * new_delayed[c, y + 1, x]
                if y:
                    along += here * new_delayed[c, y - 1, x] - high[c, y - 1, x] * late
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
