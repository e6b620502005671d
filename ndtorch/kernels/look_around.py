"""What a car sees in a step, and where it is: the first half of a whole step, whichever controller follows."""

from __future__ import annotations

from typing import Any

from ndtorch.kernels.arc import arc
from ndtorch.kernels.cell_maxima import grey_maxima
from ndtorch.kernels.row_ranges import row_ranges
from ndtorch.utils.jit import jit

Array = Any

WHOLE_NUMBERS, NUMBERS = 24, 13
"""How many of the whole numbers, and of the others, are used here; those of the controller come after them."""

ranged, driven = row_ranges, jit(arc, exact=True)


@jit
def look_around(
    eyes: tuple[Array, Array, Array, Array],
    whole: Array,
    numbers: Array,
    reckoning: tuple[float, float, float],
    settle: bool,
    moved: tuple[float, float],
    before: tuple[Array, Array],
    after: tuple[Array, Array],
    valid: Array,
    grey: Array,
    gain: float,
    cells: Array,
) -> float:
    """Cells, ranges and the pose.

    Args:
        eyes: left and right frame of the fields, and of the rows, `[1, C, H, W]`, or `[1, H, W, C]` where colors lie
            beside each other; only rows are read here.
        whole: whether colors lie beside each other in the fields, and in the rows; tops and lefts of the fields, and
            the top of the rows; the count and `every` of `grey_row`; bands and blocks; height and width of the
            fields and width of the rows as the state has them; whole numbers of `finding`, one to one, and whether
            angles are exact; how many numbers the state has; `[WHOLE_NUMBERS + ...]`.
        numbers: unit of `grey_row`, shares of the filters of fields and rows, scale of the cells; then those of
            `finding`, `matching` and `rig`, `[NUMBERS + ...]`.
        reckoning: the time step, by how much the heading drifts in it, and its share of the length.
        settle: the filters begin with this frame.
        moved: speed and curvature driven.
        before, after: of the state, what is large: fields, rows, and the controller's arrays; and what is small: speed
            and curvature driven, pose, the controller's numbers; then the largest motion on both sides, the command,
            and ranges `[5, n]`. Of `after`, fields, rows, pose and ranges are filled here.
        valid: of the ranges, `[n]`.
        grey, gain: of the fields, see `grey_maxima`.
        cells: becomes the largest motion in every cell, `[2, bands, blocks]`.

    Returns:
        The largest motion in the rows.
    """
    kind = cells.dtype.type
    height, width, line = whole[11], whole[12], whole[13]
    pixels, first = 2 * height * width, whole[23]
    low, new_low = before[0][:pixels].reshape((2, height, width)), after[0][:pixels].reshape((2, height, width))
    rows = before[0][pixels : pixels + 2 * line].reshape((2, line))
    new_rows = after[0][pixels : pixels + 2 * line].reshape((2, line))
    grey_maxima(grey, settle, low, gain, numbers[1], new_low, cells)
    n = whole[14]
    out = after[1][first + 4 : first + 4 + 5 * n].reshape((5, n))
    kept = (whole[18], whole[19], whole[20])
    largest = ranged(
        (eyes[2][0], eyes[3][0]),
        whole[1] != 0,
        whole[6],
        numbers[0],
        whole[7],
        settle,
        rows,
        numbers[2],
        new_rows,
        (n, whole[15], numbers[4], numbers[5], whole[16], whole[17], kept),
        (numbers[6], numbers[7], whole[21] != 0, numbers[8]),
        (numbers[9], numbers[10], numbers[11], numbers[12], whole[22] != 0),
        out,
        valid,
    )
    old, new = before[1], after[1]
    dt, drift, scale = reckoning
    here = (float(old[2]), float(old[3]), float(old[4]))
    x, y, heading = driven(here[0], here[1], here[2], float(kind(moved[0])) * scale, float(kind(moved[1])), dt)
    new[2], new[3], new[4] = kind(x), kind(y), kind(heading + drift)
    return float(largest)
