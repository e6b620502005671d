"""A step of many cars with the published controller, one after the other."""

from __future__ import annotations

import math
from typing import Any

from ndtorch.kernels.inner import inner
from ndtorch.kernels.published_step import published_step

Array = Any

stepped = inner(published_step)


def published_cars(
    left_field: Array,
    right_field: Array,
    left_row: Array,
    right_row: Array,
    whole: Array,
    numbers: Array,
    dt: float,
    drift: float,
    scale: float,
    given: bool,
    moved: Array,
    large: Array,
    small: Array,
    new_large: Array,
    new_small: Array,
    valid: Array,
) -> float:
    """`published_step` of each car.

    Args:
        left_field, right_field, left_row, right_row: `[B, 1, C, H, W]`.
        given, moved: whether somebody says what was driven, and speeds and curvatures, `[2, B]`.
        large, small, new_large, new_small, valid: `[B, ...]`.

    Returns:
        The largest magnitude of motion; NaN where there is one.
    """
    largest = 0.0
    for car in range(valid.shape[0]):
        one, other, _ = stepped(
            left_field[car],
            right_field[car],
            left_row[car],
            right_row[car],
            whole,
            numbers,
            dt,
            drift,
            scale,
            False,
            given,
            moved[0, car],
            moved[1, car],
            large[car],
            small[car],
            new_large[car],
            new_small[car],
            valid[car],
        )
        for peak in (one, other):
            largest = peak if peak > largest or math.isnan(peak) else largest
    return largest
