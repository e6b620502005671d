"""The cells of a map that ranged features fall into, and the certainty each gets."""

from __future__ import annotations

import math
from typing import Any

from ndtorch.utils.jit import jit

Array = Any


@jit
def beam_cells(
    left_angle: Array,
    right_angle: Array,
    valid: Array,
    tangent: Array,
    weight: Array,
    rig: tuple[float, float, float],
    pose: tuple[float, float, float],
    grid: tuple[float, float, float],
    scale: float,
    down: Array,
    across: Array,
    numbers: Array,
    weights: Array,
) -> int:
    """`sample_certainty`, `to_world` and the numbers of cells of one frame's features.

    Args:
        left_angle, right_angle, valid: of `Ranges`, `[n]`.
        tangent, weight: of `BeamTable`, `[2, S]` and `[S]`.
        rig: baseline, forward, reach of the beams.
        pose: of the car.
        grid: x and y where cell 0 begins, side of a cell.
        scale: factor of the weights.
        down, across: numbers of rows and columns, see `cell_tables`.
        numbers, weights: `[n * S]`; of features that are not valid there are none.

    Returns:
        How many there are.
    """
    kind, count = weights.dtype.type, 0
    baseline, forward, reach = rig
    nearest = kind(baseline / 100.0)
    cos, sin = kind(math.cos(pose[2])), kind(math.sin(pose[2]))
    here, there = kind(pose[0]), kind(pose[1])
    begin, bottom, per = kind(grid[0]), kind(grid[1]), kind(1 / grid[2])
    last_row, last_column = kind(down.shape[0] - 1), kind(across.shape[0] - 1)
    for i in range(valid.shape[0]):
        if not valid[i]:
            continue
        left_tan, right_tan = kind(math.tan(left_angle[i])), kind(math.tan(right_angle[i]))
        for s in range(weight.shape[0]):
            left = (left_tan + tangent[0, s]) / (kind(1) - left_tan * tangent[0, s])
            right = (right_tan + tangent[1, s]) / (kind(1) - right_tan * tangent[1, s])
            x = kind(baseline) / max(right - left, nearest)
            far, near = left * left + kind(1), right * right + kind(1)
            falloff = kind(math.exp((kind(math.sqrt(far)) + kind(math.sqrt(near))) * x * kind(-1 / reach)))
            weights[count] = falloff * (x * x * x * (far * near)) * weight[s] * kind(scale)
            aside = left * x + kind(baseline / 2)
            x += kind(forward)
            column = min(max((here + cos * x - sin * aside - begin) * per, kind(0)), last_column)
            row = min(max((there + sin * x + cos * aside - bottom) * per, kind(0)), last_row)
            numbers[count] = down[int(row)] + across[int(column)]
            count += 1
    return count
