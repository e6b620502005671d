"""Kernel of the ten sums: motion, color and thinned grey images of frames in one pass over the pixels."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ndtorch.utils.jit import jit

Array = Any

BAND = 4
"""Rows of pixels that all frames go through before the next ones: so many rows of the states stay in the cache."""


class PassConstants(NamedTuple):
    """What a pass over frames needs to know.

    Attributes:
        a_high, a_low: shares of the filters of the motion detectors.
        wrap: correlate across the border as well.
        block: rows that become one, a power of two.
        margins: mirrored rows above and below, and columns at both sides.
    """

    a_high: float
    a_low: float
    wrap: bool
    block: int
    margins: tuple[int, int]


@jit
def front_end(
    frames: Array,
    beside: bool,
    unit: float,
    settle: bool,
    slow: Array,
    delayed: Array,
    constants: PassConstants,
    images: Array,
    sums: Array,
) -> None:
    """`front_step` and the first steps of `OrientedDoG.sums`, row by row, so that a row is read once.

    The states, which are larger than a cache, are read and written once for all frames.

    Args:
        frames: `[T, 3, H, W]`, or `[T, H, W, 3]` where colors lie `beside` each other.
        unit: factor that scales it to 0..1.
        settle: the state before is that of filters settled on the first frame, whatever is given.
        slow, delayed: `MotionState` before, `[H, W]`; they become that after the last frame.
        images: become the grey images with their margins, rows and columns thinned as by `thin_rows`, `[T, h, w]`.
        sums: across, its magnitude, along, its magnitude, red, green and blue, `[T, 7]` float64.
    """
    a_high, a_low, wrap, block, margins = constants
    (times, kept, _), (height, width), margin = images.shape, slow.shape, margins[0]
    kind = slow.dtype.type
    third, shares = kind(unit / 3), (a_high, a_low)
    greys, highs = np.empty((BAND, width), slow.dtype), np.empty((BAND, width), slow.dtype)
    rows = np.zeros((times, kept, width), slow.dtype)
    # The first row is kept for where the torus closes, the last one of a band for the next.
    first, last = np.empty((times, 2, width), slow.dtype), np.empty((times, 2, width), slow.dtype)
    # Four rows between the middles of two blocks are added at once, where none is mirrored in a margin. Such rows
    # begin two rows into a block, and so do bands.
    inner_from, inner_to = (2 * margin + 2) // 4 * 4 + 2 - margin, (height - 3) // 4 * 4 + 2 - margin
    sums[:] = 0
    unused, pixels = np.zeros(2), frames.reshape(times, -1)
    flat = (slow.reshape(-1), delayed.reshape(-1), greys.reshape(-1), highs.reshape(-1))
    colors = np.empty((3, BAND * width if beside else 0), frames.dtype)
    for begin in range(-((margin + 2) % 4), height, BAND):
        top, bottom = max(begin, 0), min(begin + BAND, height)
        count = bottom - top
        high, grey, late = highs[:count], greys[:count], delayed[top:bottom]
        begins, ends = top * width, bottom * width
        states, out = (flat[0][begins:ends], flat[1][begins:ends]), (flat[2][: ends - begins], flat[3][: ends - begins])
        for t in range(times):
            total, settled = sums[t], settle and t == 0
            planes = color_planes(pixels[t], beside, begins, ends, colors)
            r, g, b = filter_row(planes, third, settled, *states, shares, *out)
            total[4], total[5], total[6] = total[4] + r, total[5] + g, total[6] + b
            ahead, along, over = total[0:2], total[2:4], total[2:4]
            if top == 0:
                keep(high[0], late[0], first[t])
                keep(high[0], late[0], last[t])
                over = unused
            correlate(high[:1], late[:1], last[t, :1], last[t, 1:], (ahead, over))
            correlate(high[1:], late[1:], high[:-1], late[:-1], (ahead, along))
            keep(high[count - 1], late[count - 1], last[t])
            if wrap:
                for y in range(count):
                    signed = high[y, 0] * late[y, width - 1] - high[y, width - 1] * late[y, 0]
                    total[0], total[1] = total[0] + signed, total[1] + abs(signed)
            if block == 4 and inner_from <= top < inner_to:
                here = (top + margin) // 4
                add_four(grey, rows[t, here], rows[t, here + 1])
            else:
                for y in range(count):
                    add_mirrored(grey[y], top + y, height, margin, block, rows[t])
    for t in range(times):
        total = sums[t]
        if wrap:
            correlate(first[t, :1], first[t, 1:], last[t, :1], last[t, 1:], (unused, total[2:4]))
        for color in range(4, 7):
            total[color] *= unit
        thin_columns(rows[t], margins[1], images[t])


@jit
def keep(high: Array, late: Array, both: Array) -> None:
    """Keep a row as high-passed and as delayed, `[2, W]`."""
    for x in range(high.shape[0]):
        both[0, x], both[1, x] = high[x], late[x]


@jit
def add_four(greys: Array, here: Array, there: Array) -> None:
    """`add_thinned` of four rows at once: the last two of a block and the first two of the next."""
    kind = here.dtype.type
    least, less, more, most = kind(0.125), kind(0.375), kind(0.625), kind(0.875)
    one, two, three, four = greys[0], greys[1], greys[2], greys[3]
    for x in range(here.shape[0]):
        here[x] += most * one[x] + more * two[x] + less * three[x] + least * four[x]
        there[x] += least * one[x] + less * two[x] + more * three[x] + most * four[x]


@jit
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


@jit
def add_mirrored(row: Array, y: int, height: int, margin: int, block: int, rows: Array) -> None:
    """Add a row of the image, and where it is mirrored in the margins, to what its blocks become."""
    add_thinned(row, y + margin, block, rows)
    if 0 < y <= margin:
        add_thinned(row, margin - y, block, rows)
    if 0 < height - 1 - y <= margin:
        add_thinned(row, margin + 2 * (height - 1) - y, block, rows)


@jit
def filter_row(
    colors: tuple[Array, Array, Array],
    third: float,
    settle: bool,
    slow: Array,
    delayed: Array,
    shares: tuple[float, float],
    image: Array,
    high: Array,
) -> tuple[float, float, float]:
    """Grey and the filters of one row in one loop, and sums of the colors: every number is read and written once.

    `third` scales the sum of the colors to grey in 0..1; `slow` and `delayed` become the states after it, `image` and
    `high` the grey and the high-passed row. None of these arrays may overlap another: loops would not be made of vector
    instructions. Numbers that have died away become zero: as denormals they would make later frames ten times slower.
    """
    kind = image.dtype.type
    tiny, a_high, a_low = kind(1e-30), kind(shares[0]), kind(shares[1])
    red, green, blue = colors
    r, g, b = kind(0), kind(0), kind(0)
    for x in range(image.shape[0]):
        one, two, three = kind(red[x]), kind(green[x]), kind(blue[x])
        r, g, b = r + one, g + two, b + three
        grey = (one + two + three) * third
        image[x] = grey
        mean, last = (grey, kind(0)) if settle else (slow[x], delayed[x])
        mean = mean + a_high * (grey - mean)
        fast = grey - mean
        last = last + a_low * (fast - last)
        high[x] = fast
        delayed[x] = last if abs(last) > tiny else kind(0)
        slow[x] = mean if abs(mean) > tiny else kind(0)
    return r, g, b


@jit
def split_colors(row: Array, red: Array, green: Array, blue: Array) -> None:
    """Planes of pixels whose colors lie beside each other: one step of 3 that the compiler knows is vector loads."""
    for x in range(row.shape[0] // 3):
        k = np.uintp(3 * x)
        red[x], green[x], blue[x] = row[k], row[k + np.uintp(1)], row[k + np.uintp(2)]


@jit
def color_planes(pixels: Array, beside: bool, begin: int, end: int, buffer: Array) -> tuple[Array, Array, Array]:
    """Red, green and blue of some pixels of a frame, each without gaps: in the buffer where they lie `beside` each
    other."""
    if beside:
        count = end - begin
        split_colors(pixels[3 * begin : 3 * end], buffer[0], buffer[1], buffer[2])
        return buffer[0, :count], buffer[1, :count], buffer[2, :count]
    plane = pixels.shape[0] // 3
    green, blue = plane + begin, 2 * plane + begin
    return pixels[begin:end], pixels[green : plane + end], pixels[blue : 2 * plane + end]


@jit
def correlate(high: Array, late: Array, high_before: Array, late_before: Array, total: tuple[Array, Array]) -> None:
    """Sums and sums of magnitudes of `high late' - high' late` of rows `[R, W]`, added to the totals across and along,
    `[2]` each: with the left neighbour, and with the row before."""
    along_row, over_rows = total
    for y in range(high.shape[0]):
        left, right = (high[y, :-1], late[y, :-1]), (high[y, 1:], late[y, 1:])
        across, across_size, along, along_size = correlate_row(left, right, (high_before[y, 1:], late_before[y, 1:]))
        signed = high[y, 0] * late_before[y, 0] - high_before[y, 0] * late[y, 0]
        along_row[0], along_row[1] = along_row[0] + across, along_row[1] + across_size
        over_rows[0], over_rows[1] = over_rows[0] + along + signed, over_rows[1] + along_size + abs(signed)


@jit
def correlate_row(
    left: tuple[Array, Array], right: tuple[Array, Array], above: tuple[Array, Array]
) -> tuple[float, float, float, float]:
    """The sums of `correlate` of one row: neighbours are slices, whose indices need no check of their sign."""
    (high_left, late_left), (high, late), (high_above, late_above) = left, right, above
    kind = high.dtype.type
    across, across_size, along, along_size = kind(0), kind(0), kind(0), kind(0)
    for x in range(high.shape[0]):
        signed = high[x] * late_left[x] - high_left[x] * late[x]
        across, across_size = across + signed, across_size + abs(signed)
        signed = high[x] * late_above[x] - high_above[x] * late[x]
        along, along_size = along + signed, along_size + abs(signed)
    return across, across_size, along, along_size


@jit
def add_weighted(row: Array, weight: float, total: Array) -> None:
    """`total += weight row`."""
    for x in range(row.shape[0]):
        total[x] += weight * row[x]


@jit
def add_to_two(row: Array, weights: tuple[float, float], here: Array, there: Array) -> None:
    """The same to two others."""
    one, two = weights
    for x in range(row.shape[0]):
        here[x] += one * row[x]
        there[x] += two * row[x]


@jit
def thin_columns(rows: Array, margin: int, image: Array) -> None:
    """`thin_rows` of the columns of `[R, W]` with mirrored margins, into an image `[R, (W + 2 margin) / block]`: halved
    around the middles of pairs, and again as often as it takes."""
    height, width = rows.shape
    length = width + 2 * margin
    times = 0
    while length >> times > image.shape[1]:
        times += 1
    # A closed line: before it stands its last number, and after it its first two.
    line, halves = np.empty(length + 3, rows.dtype), np.empty((max(times - 1, 1), length // 2 + 1), rows.dtype)
    for y in range(height):
        copy_row(rows[y], line[1 + margin :])
        for x in range(margin):
            line[1 + x] = rows[y, margin - x]
            line[1 + margin + width + x] = rows[y, width - 2 - x]
        line[0], line[length + 1], line[length + 2] = line[length], line[1], line[2]
        if times == 0:
            for x in range(length):
                image[y, x] = line[1 + x]
        elif times == 1:
            halve_pairs(line, 0, length // 2, image[y])
        else:
            # The middle of a block lies between its second quarter and its third: one pixel further on, at first.
            halve_pairs(line, 1, length // 2, halves[0])
            halves[0, length // 2] = halves[0, 0]
            for level in range(1, times - 1):
                halve_odd(halves[level - 1], length >> (level + 1), halves[level])
            halve_even(halves[times - 2], length >> times, image[y])


@jit
def copy_row(row: Array, line: Array) -> None:
    """Copy a row to where a line begins: a view of it, since with numbers of places added up it is no vector loop."""
    for x in range(row.shape[0]):
        line[x] = row[x]


@jit
def halve_pairs(line: Array, first: int, length: int, half: Array) -> None:
    """Half of the numbers of a line from `first` on: weights 1/4, 3/4, 3/4, 1/4 around the middles of pairs."""
    quarter, most = half.dtype.type(0.25), half.dtype.type(0.75)
    for c in range(length):
        x = 2 * c + first
        half[c] = quarter * (line[x] + line[x + 3]) + most * (line[x + 1] + line[x + 2])


@jit
def halve_odd(line: Array, length: int, half: Array) -> None:
    """Every second number of a closed line from the second on, smoothed with weights 1/2, 1, 1/2 beforehand."""
    share = half.dtype.type(0.5)
    for c in range(length):
        half[c] = line[2 * c + 1] + share * (line[2 * c] + line[2 * c + 2])
    half[length] = half[0]


@jit
def halve_even(line: Array, length: int, half: Array) -> None:
    """The same from the first number on."""
    share = half.dtype.type(0.5)
    half[0] = line[0] + share * (line[2 * length - 1] + line[1])
    for c in range(1, length):
        half[c] = line[2 * c] + share * (line[2 * c - 1] + line[2 * c + 1])
