"""A step of a car that only avoids: from the pixels of both fields to speed and curvature."""

from __future__ import annotations

from typing import Any

import numpy as np

from ndtorch.kernels.avoidance import avoidance
from ndtorch.kernels.cell_maxima import cell_maxima
from ndtorch.utils.jit import jit

Array = Any

largest_in_cells, decided = cell_maxima, jit(avoidance, exact=True)


@jit
def avoid(
    left: Array,
    right: Array,
    where: Array,
    numbers: Array,
    settle: bool,
    low: Array,
    machine: Array,
    new_low: Array,
    new_machine: Array,
) -> tuple[float, float]:
    """`SubfieldMotion` and `SaccadeAvoidance` of one frame of each camera.

    Args:
        left, right: `[C, H, W]`, or `[H, W, C]` where colors lie beside each other.
        where: whether they do so, tops and lefts of the fields, and the age of a car that begins, in steps.
        numbers: unit of a pixel, share of the high-pass, scale of its output, and those of `AvoidanceConstants`.
        settle: begin with this frame.
        low, new_low: states of the fields, `[2, h, w]`.
        machine, new_machine: of `AvoidanceState`, `[3]`.

    Returns:
        Speed and curvature.
    """
    kind, cells = low.dtype.type, np.empty((2, 1, 1), low.dtype)
    tops, lefts = (where[1], where[2]), (where[3], where[4])
    largest_in_cells(
        (left, right), where[0] != 0, tops, lefts, 1, numbers[0], 1, settle, low, 1.0, numbers[1], new_low, cells
    )
    ours, theirs = cells[0, 0, 0] * kind(numbers[2]), cells[1, 0, 0] * kind(numbers[2])
    before = (float(machine[0]), float(machine[1]), float(machine[2]))
    if settle:
        before = (float(theirs - ours), float(where[5]), 0.0)
    speed, curvature, after = decided(
        float(ours),
        float(theirs),
        before,
        (numbers[3], numbers[4], numbers[5], numbers[6], numbers[7], numbers[8], numbers[9], numbers[10], numbers[11]),
    )
    new_machine[0], new_machine[1], new_machine[2] = after
    return speed, curvature
