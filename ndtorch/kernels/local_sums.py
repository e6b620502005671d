"""One pass over a frame for many receptive fields: what `front_end` does, with sums over every field."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array, copy_row, filter_row
from ndtorch.kernels.front_end import add_mirrored
from ndtorch.kernels.inner import inner


def local_sums(
    frame: Array,
    beside: bool,
    unit: float,
    settle: bool,
    slow: Array,
    delayed: Array,
    a_high: float,
    a_low: float,
    wrap: bool,
    block: int,
    margin: int,
    new_slow: Array,
    new_delayed: Array,
    rows: Array,
    columns: Array,
    spans: Array,
    places: Array,
    shares: Array,
    sums: Array,
) -> None:
    """Motion and color in every field of `LocalFeatures`.

    Args:
        frame, beside, unit, settle, slow, delayed, a_high, a_low, wrap, block, margin: as of `front_end`, like
            new_slow, new_delayed and rows, which are filled.
        columns: weights of pixels, and of what lies between them, `[2, C, W]`.
        spans: where those of each field are not zero, twice from here to there, `[2, C, 4]`.
        places: the two rows of fields to which a row of pixels belongs, and what lies below it, `[2, H, 2]`.
        shares: how much, `[2, H, 2]`.
        sums: left, right, down, up, red, green, blue, `[7, R, C]`; they become those of this frame.
    """
    height, width = slow.shape
    kind = slow.dtype.type
    third, filters = kind(unit / 3), (a_high, a_low)
    image, low = np.empty(width, slow.dtype), np.empty(width, slow.dtype)
    more, less = np.zeros(width, slow.dtype), np.zeros(width, slow.dtype)
    down, up = np.empty(width, slow.dtype), np.empty(width, slow.dtype)
    highs, lates = np.empty((3, width), slow.dtype), np.empty((3, width), slow.dtype)
    rows[:] = 0
    sums[:] = 0
    for y in range(height):
        now = 1 + y % 2 if y else 0
        last = 2 - y % 2 if y > 1 else 0
        high, late = highs[now], lates[now]
        before = (slow[y], delayed[y])
        if beside:
            colors = (frame[y, :, 0], frame[y, :, 1], frame[y, :, 2])
            filter_row(colors, third, settle, before, filters, image, low, high, late)
            for c in range(3):
                pool_row(colors[c], columns[0], spans[0], places[0, y], shares[0, y], sums[4 + c])
        else:
            planes = (frame[0, y], frame[1, y], frame[2, y])
            filter_row(planes, third, settle, before, filters, image, low, high, late)
            for c in range(3):
                pool_row(planes[c], columns[0], spans[0], places[0, y], shares[0, y], sums[4 + c])
        copy_row(low, new_slow[y])
        copy_row(late, new_delayed[y])
        halves(high[1:], late[:-1], high[:-1], late[1:], more, less)
        if wrap:
            signed = high[0] * late[width - 1] - high[width - 1] * late[0]
            more[width - 1], less[width - 1] = max(signed, kind(0)), max(-signed, kind(0))
        pool_row(less, columns[1], spans[1], places[0, y], shares[0, y], sums[0])
        pool_row(more, columns[1], spans[1], places[0, y], shares[0, y], sums[1])
        if y:
            halves(high, lates[last], highs[last], late, down, up)
            pool_row(down, columns[0], spans[0], places[1, y - 1], shares[1, y - 1], sums[2])
            pool_row(up, columns[0], spans[0], places[1, y - 1], shares[1, y - 1], sums[3])
        add_mirrored(image, y, height, margin, block, rows)
    if wrap:
        end, y = 1 + (height - 1) % 2 if height > 1 else 0, height - 1
        halves(highs[0], lates[end], highs[end], lates[0], down, up)
        pool_row(down, columns[0], spans[0], places[1, y], shares[1, y], sums[2])
        pool_row(up, columns[0], spans[0], places[1, y], shares[1, y], sums[3])
    for c in range(4, 7):
        for row in range(sums.shape[1]):
            for column in range(sums.shape[2]):
                sums[c, row, column] *= unit


@inner
def halves(high: Array, late_before: Array, high_before: Array, late: Array, more: Array, less: Array) -> None:
    """Positive and negative part of `high late_before - high_before late`."""
    none = more.dtype.type(0)
    for x in range(high.shape[0]):
        signed = high[x] * late_before[x] - high_before[x] * late[x]
        more[x] = signed if signed > none else none
        less[x] = -signed if signed < none else none


@inner
def pool_row(signal: Array, columns: Array, spans: Array, places: Array, shares: Array, sums: Array) -> None:
    """Add what every column of fields sees of a row to two rows of fields, `[R, C]`."""
    kind = columns.dtype.type
    above, below = sums[places[0]], sums[places[1]]
    for c in range(columns.shape[0]):
        total, weights = kind(0), columns[c]
        for x in range(spans[c, 0], spans[c, 1]):
            total += kind(signal[x]) * weights[x]
        for x in range(spans[c, 2], spans[c, 3]):
            total += kind(signal[x]) * weights[x]
        above[c] += shares[0] * total
        below[c] += shares[1] * total
