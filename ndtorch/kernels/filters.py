"""What kernels do with one row of pixels: grey, the filters of the motion detectors, correlation of neighbours."""

from __future__ import annotations

from typing import Any

from ndtorch.utils.jit import jit

Array = Any
"""A NumPy array, or one row of it."""


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
    """Grey and `motion_step` of one row in one loop: every number is read and written once.

    Numbers that have died away become zero: as denormals they would make every later frame ten times slower.

    Args:
        colors: red, green and blue.
        third: scales their sum to grey in 0..1.
        settle: the state before is that of filters settled on this row, whatever is given.
        slow, delayed: states, which become those after it. None of these arrays may overlap another: loops would not
            be made of vector instructions.
        shares: of the high-pass and of the low-pass.
        image, high: become grey and the high-passed row.

    Returns:
        Sums of the colors.
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
def outside(colors: tuple[Array, Array, Array], unit: float) -> int:
    """How many numbers of three rows are not in 0..1 once they are scaled by `unit`, with some slack, or no numbers."""
    low, high, wrong = -0.01 / unit, 1.01 / unit, 0
    for row in colors:
        for x in range(row.shape[0]):
            wrong += 0 if low <= row[x] <= high else 1
    return wrong


@jit
def correlate(
    high: Array, late: Array, high_before: Array, late_before: Array, lag: int, total: tuple[Array, Array]
) -> None:
    """Sums and sums of magnitudes of `high late' - high' late`: with the left neighbour, and with the row before.

    Args:
        high, late: rows `[R, W]`.
        high_before, late_before: those before each.
        lag: 1, unsigned. Where the compiler knew that, it would shuffle vectors instead of loading neighbours.
        total: the sums across and along are added to these, `[2]` each.
    """
    kind, (rows, width) = high.dtype.type, high.shape
    along_row, over_rows = total
    for y in range(rows):
        across, across_size, along, along_size = kind(0), kind(0), kind(0), kind(0)
        for x in range(width - lag):
            here, now = high[y, x + lag], late[y, x + lag]
            signed = here * late[y, x] - high[y, x] * now
            across, across_size = across + signed, across_size + abs(signed)
            signed = here * late_before[y, x + lag] - high_before[y, x + lag] * now
            along, along_size = along + signed, along_size + abs(signed)
        signed = high[y, 0] * late_before[y, 0] - high_before[y, 0] * late[y, 0]
        along_row[0], along_row[1] = along_row[0] + across, along_row[1] + across_size
        over_rows[0], over_rows[1] = over_rows[0] + along + signed, over_rows[1] + along_size + abs(signed)


@jit
def add_weighted(row: Array, weight: float, total: Array) -> None:
    """`total += weight row`."""
    for x in range(row.shape[0]):
        total[x] += weight * row[x]


@jit
def add_to_two(row: Array, weights: tuple[float, float], here: Array, there: Array) -> None:
    """`add_weighted` to two others."""
    one, two = weights
    for x in range(row.shape[0]):
        here[x] += one * row[x]
        there[x] += two * row[x]
