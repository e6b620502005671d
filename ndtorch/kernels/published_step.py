"""A whole step of a car with the published controller: from the pixels to the command."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ndtorch.kernels.arc import arc
from ndtorch.kernels.avoidance import avoidance
from ndtorch.kernels.cell_maxima import cell_maxima
from ndtorch.kernels.load import FAST
from ndtorch.kernels.row_ranges import row_ranges
from ndtorch.kernels.strips import larger

Array = Any

largest_in_cells = numba.njit(fastmath=FAST, error_model="numpy")(cell_maxima)
ranged = numba.njit(fastmath=FAST, error_model="numpy")(row_ranges)
driven = numba.njit(error_model="numpy")(arc)
decided = numba.njit(error_model="numpy")(avoidance)


def published_step(
    fields: tuple[Array, Array],
    rows: tuple[Array, Array],
    beside: tuple[bool, bool],
    where: tuple[int, int, int, int, int],
    grey: tuple[float, int],
    settle: bool,
    shares: tuple[float, float],
    low: tuple[Array, Array],
    new_low: tuple[Array, Array],
    finding: tuple[int, int, float, float, int, int, tuple[int, int, int]],
    matching: tuple[float, float, bool, float],
    rig: tuple[float, float, float, float, bool],
    numbers: Array,
    step: tuple[float, float, float, float],
    out: Array,
    valid: Array,
    sides: Array,
    after: Array,
    constants: tuple[float, ...],
) -> tuple[float, float]:
    """The step of `Navigator` of one car and one frame.

    Args:
        fields, rows: pixels of both eyes, `[C, H, W]`, or `[H, W, C]` where their colors lie `beside` each other.
        where: tops and lefts of the fields, and the top of the rows.
        grey: unit and count of `grey_row`.
        settle, shares: of `high_pass`, of fields and rows.
        low, new_low: states of fields `[2, h, w]` and rows `[2, W]`.
        finding, matching, rig, out, valid: of `row_ranges`.
        numbers: speed and curvature driven; pose; state of the controller.
        step: the time step, by how much the reckoning's heading drifts in it, its share of the length, and `scale`.
        sides: the largest motion of both fields, times `scale`, `[2]`.
        after: speed and curvature to drive; pose; state of the controller.
        constants: of `AvoidanceConstants`.

    Returns:
        The largest magnitude of motion in the fields and in the rows.
    """
    unit, count = grey
    tops, lefts = (where[0], where[1]), (where[2], where[3])
    seen = np.empty((2, 1, 1), sides.dtype)
    largest_in_cells(fields, beside[0], tops, lefts, 1, unit, count, settle, low[0], shares[0], new_low[0], seen)
    largest = ranged(
        rows,
        beside[1],
        where[4],
        unit,
        count,
        settle,
        low[1],
        shares[1],
        new_low[1],
        finding,
        matching,
        rig,
        out,
        valid,
    )
    peak = larger(seen[0, 0, 0], seen[1, 0, 0])
    sides[0], sides[1] = seen[0, 0, 0] * sides.dtype.type(step[3]), seen[1, 0, 0] * sides.dtype.type(step[3])
    speed, bend, x, y, heading = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]
    x, y, heading = driven(float(x), float(y), float(heading), float(speed) * step[2], float(bend), step[0])
    machine = (float(numbers[5]), float(numbers[6]), float(numbers[7]))
    ahead, turn, state = decided(float(sides[0]), float(sides[1]), machine, constants)
    after[0], after[1], after[2], after[3], after[4] = ahead, turn, x, y, heading + step[1]
    after[5], after[6], after[7] = state
    return float(peak), largest
