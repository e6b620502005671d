"""One pass over a frame: grey, color sums, both filters of the motion detectors, their four sums, thinned rows."""

from __future__ import annotations

import numpy as np

from ndtorch.kernels.filters import Array, add_to_two, add_weighted, correlate, filter_row
from ndtorch.kernels.inner import inner


def front_end(
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
    sums: Array,
) -> None:
    """`front_step` and the first steps of `OrientedDoG.sums`, row by row, so that a row is read once.

    Args:
        frame: `[3, H, W]`, or `[H, W, 3]` where colors lie `beside` each other.
        unit: factor that scales it to 0..1.
        settle: the state before is that of filters settled on this frame, whatever is given.
        slow, delayed: `MotionState` before, `[H, W]`; they become that after it.
        a_high, a_low: shares of the filters.
        wrap: correlate across the border as well.
        block: rows that become one, a power of two.
        margin: mirrored rows above and below.
        rows: the grey image with its margins, rows thinned as by `thin_rows`, `[(H + 2 margin) / block, W]`.
        sums: across, its magnitude, along, its magnitude, red, green, blue; `[7]` float64.
    """
    height, width = slow.shape
    kind = slow.dtype.type
    third, shares = kind(unit / 3), (a_high, a_low)
    image = np.empty(width, slow.dtype)
    # The first row is kept for where the torus closes; the others take turns.
    highs = np.empty((3, width), slow.dtype)
    for place in range(rows.shape[0]):
        for x in range(width):
            rows[place, x] = 0
    across = across_size = along = along_size = red = green = blue = 0.0
    for y in range(height):
        now = 1 + y % 2 if y else 0
        last = 2 - y % 2 if y > 1 else 0
        high, late = highs[now], delayed[y]
        if beside:
            colors = (frame[y, :, 0], frame[y, :, 1], frame[y, :, 2])
            r, g, b = filter_row(colors, third, settle, slow[y], late, shares, image, high)
        else:
            planes = (frame[0, y], frame[1, y], frame[2, y])
            r, g, b = filter_row(planes, third, settle, slow[y], late, shares, image, high)
        red, green, blue = red + r, green + g, blue + b
        left, above = correlate(high, late, highs[last], delayed[max(y - 1, 0)])
        across, across_size = across + left[0], across_size + left[1]
        if y:
            along, along_size = along + above[0], along_size + above[1]
        if wrap:
            signed = high[0] * late[width - 1] - high[width - 1] * late[0]
            across, across_size = across + signed, across_size + abs(signed)
        add_mirrored(image, y, height, margin, block, rows)
    if wrap:
        end = 1 + (height - 1) % 2
        _, above = correlate(highs[0], delayed[0], highs[end], delayed[height - 1])
        along, along_size = along + above[0], along_size + above[1]
    sums[0], sums[1], sums[2], sums[3] = across, across_size, along, along_size
    sums[4], sums[5], sums[6] = red * unit, green * unit, blue * unit


@inner
def add_thinned(row: Array, place: int, block: int, rows: Array) -> None:
    """Add the row at `place` to the two blocks whose middles it lies between: a triangle of weights, as of
    `thin_rows`."""
    half_rows = 2 * place - (block - 1)
    above = half_rows // (2 * block)
    share = (half_rows - 2 * block * above) / (2 * block)
    here, there = above % rows.shape[0], (above + 1) % rows.shape[0]
    kind = rows.dtype.type
    if share > 0 and here != there:
        add_to_two(row, (kind(1 - share), kind(share)), rows[here], rows[there])
    else:
        add_weighted(row, kind(1), rows[here])


@inner
def add_mirrored(row: Array, y: int, height: int, margin: int, block: int, rows: Array) -> None:
    """Add a row of the image, and where it is mirrored in the margins, to what its blocks become."""
    add_thinned(row, y + margin, block, rows)
    if 0 < y <= margin:
        add_thinned(row, margin - y, block, rows)
    if 0 < height - 1 - y <= margin:
        add_thinned(row, margin + 2 * (height - 1) - y, block, rows)
