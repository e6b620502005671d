"""One pass over a frame for many receptive fields: what `front_end` does, with sums over every field."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array, filter_row
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
    rows: Array,
    columns: Array,
    places: Array,
    shares: Array,
    sums: Array,
) -> None:
    """Motion and color in every field of `LocalFeatures`.

    Args:
        frame, beside, unit, settle, slow, delayed, a_high, a_low, wrap, block, margin: as of `front_end`, like rows,
            which are filled.
        columns: weights of pixels, and of what lies between them, `[2, C, W]`.
        places: the two rows of fields to which a row of pixels belongs, and what lies below it, `[2, H, 2]`.
        shares: how much, `[2, H, 2]`.
        sums: left, right, down, up, red, green, blue, `[7, R, C]`; they become those of this frame.
    """
    height, width = slow.shape
    kind = slow.dtype.type
    third, filters = kind(unit / 3), (a_high, a_low)
    image = np.empty(width, slow.dtype)
    more, less = np.zeros(width, slow.dtype), np.zeros(width, slow.dtype)
    down, up = np.empty(width, slow.dtype), np.empty(width, slow.dtype)
    highs = np.empty((3, width), slow.dtype)
    rows[:] = 0
    # Rows first: what belongs to a row of fields stays in the cache while it grows.
    bands = np.zeros((7, sums.shape[1], width), slow.dtype)
    for y in range(height):
        now = 1 + y % 2 if y else 0
        last = 2 - y % 2 if y > 1 else 0
        high, late = highs[now], delayed[y]
        if beside:
            colors = (frame[y, :, 0], frame[y, :, 1], frame[y, :, 2])
            filter_row(colors, third, settle, slow[y], late, filters, image, high)
            for c in range(3):
                add_row(colors[c], places[0, y], shares[0, y], bands[4 + c])
        else:
            planes = (frame[0, y], frame[1, y], frame[2, y])
            filter_row(planes, third, settle, slow[y], late, filters, image, high)
            for c in range(3):
                add_row(planes[c], places[0, y], shares[0, y], bands[4 + c])
        halves(high[1:], late[:-1], high[:-1], late[1:], more, less)
        if wrap:
            signed = high[0] * late[width - 1] - high[width - 1] * late[0]
            more[width - 1], less[width - 1] = max(signed, kind(0)), max(-signed, kind(0))
        add_row(less, places[0, y], shares[0, y], bands[0])
        add_row(more, places[0, y], shares[0, y], bands[1])
        if y:
            halves(high, delayed[y - 1], highs[last], late, down, up)
            add_row(down, places[1, y - 1], shares[1, y - 1], bands[2])
            add_row(up, places[1, y - 1], shares[1, y - 1], bands[3])
        add_mirrored(image, y, height, margin, block, rows)
    if wrap:
        end, y = 1 + (height - 1) % 2 if height > 1 else 0, height - 1
        halves(highs[0], delayed[y], highs[end], delayed[0], down, up)
        add_row(down, places[1, y], shares[1, y], bands[2])
        add_row(up, places[1, y], shares[1, y], bands[3])
    for signal in range(7):
        weights = columns[1 if signal < 2 else 0]
        scale = unit if signal > 3 else 1.0
        for row in range(sums.shape[1]):
            for column in range(sums.shape[2]):
                sums[signal, row, column] = scale * dot(bands[signal, row], weights[column])


@inner
def halves(high: Array, late_before: Array, high_before: Array, late: Array, more: Array, less: Array) -> None:
    """Positive and negative part of `high late_before - high_before late`."""
    none = more.dtype.type(0)
    for x in range(high.shape[0]):
        signed = high[x] * late_before[x] - high_before[x] * late[x]
        more[x] = signed if signed > none else none
        less[x] = -signed if signed < none else none


@inner
def add_row(signal: Array, places: Array, shares: Array, bands: Array) -> None:
    """Add a row to the two bands `[R, W]` it belongs to."""
    kind = bands.dtype.type
    one, other = shares[0], shares[1]
    above, below = bands[places[0]], bands[places[1]]
    for x in range(signal.shape[0]):
        value = kind(signal[x])
        above[x] += one * value
        below[x] += other * value


@inner
def dot(row: Array, weights: Array) -> float:
    """Sum of products."""
    total = row.dtype.type(0)
    for x in range(row.shape[0]):
        total += row[x] * weights[x]
    return float(total)
