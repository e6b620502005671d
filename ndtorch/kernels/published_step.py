"""A whole step of a car with the published controller: from the pixels to the command."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch.kernels.avoidance import avoidance
from ndtorch.kernels.look_around import NUMBERS, look_around
from ndtorch.kernels.strips import grey_rows, larger
from ndtorch.utils.jit import jit

Array = Any

seen, decided = look_around, jit(avoidance, exact=True)


@jit
def published_step(
    left_field: Array,
    right_field: Array,
    left_row: Array,
    right_row: Array,
    whole: Array,
    numbers: Array,
    dt: float,
    drift: float,
    scale: float,
    settle: bool,
    given: bool,
    speed: float,
    curvature: float,
    large: Array,
    small: Array,
    new_large: Array,
    new_small: Array,
    valid: Array,
) -> tuple[float, float, bool]:
    """The step of `Navigator` of one car and one frame.

    Args:
        left_field, right_field, left_row, right_row: pixels, `eyes` of `look_around`.
        whole, numbers: of `look_around`; the controller's numbers are those of `AvoidanceConstants`.
        dt, drift, scale: `reckoning` of `look_around`.
        given, speed, curvature: whether somebody says what was driven, and what.
        settle, large, small, new_large, new_small, valid: of `look_around`.

    Returns:
        The largest magnitude of motion in the fields and in the rows, and whether the controller's caution has
        something to say.
    """
    cells, grey = np.empty((2, 1, 1), large.dtype), np.empty((2, whole[11], whole[12]), large.dtype)
    frames, tops, lefts = (left_field[0], right_field[0]), (whole[2], whole[3]), (whole[4], whole[5])
    grey_rows(frames, whole[0] != 0, tops, lefts, whole[8], numbers[0], whole[7], grey)
    eyes = (left_field, right_field, left_row, right_row)
    driven = (speed, curvature) if given else (float(small[0]), float(small[1]))
    largest = seen(
        eyes,
        whole,
        numbers,
        (dt, drift, scale),
        settle,
        driven,
        (large, small),
        (new_large, new_small),
        valid,
        grey,
        1.0,
        cells,
    )
    kind, at = cells.dtype.type, whole[23]
    peak = larger(cells[0, 0, 0], cells[1, 0, 0])
    new_small[at], new_small[at + 1] = cells[0, 0, 0] * kind(numbers[3]), cells[1, 0, 0] * kind(numbers[3])
    machine = (float(small[5]), float(small[6]), float(small[7]))
    ahead, turn, state = decided(
        float(new_small[at]),
        float(new_small[at + 1]),
        machine,
        (
            numbers[NUMBERS + 0],
            numbers[NUMBERS + 1],
            numbers[NUMBERS + 2],
            numbers[NUMBERS + 3],
            numbers[NUMBERS + 4],
            numbers[NUMBERS + 5],
            numbers[NUMBERS + 6],
            numbers[NUMBERS + 7],
            numbers[NUMBERS + 8],
        ),
    )
    new_small[0] = new_small[at + 2] = ahead
    new_small[1] = new_small[at + 3] = turn
    new_small[5], new_small[6], new_small[7] = state
    return float(peak), largest, False
