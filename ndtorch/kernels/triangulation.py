"""From columns of both rows to ranges, as `triangulate` of `ndtorch.navigation.ranging` has them."""

from __future__ import annotations

import math

from ndtorch.kernels.strips import Array
from ndtorch.utils.jit import jit


@jit(exact=True)
def triangulate(column: Array, rig: tuple[float, float, float, float, bool], out: Array, valid: Array) -> None:
    """Range, left and right angle, x and y into `out` `[5, n]`, whose first line holds the right columns before.

    Args:
        column: left columns, `[n]`.
        rig: column of the axes, factor to angles, baseline, forward, and whether angles are exact.
        valid: `[n]`; what is not valid, or does not meet ahead, becomes 0.
    """
    kind = out.dtype.type
    axis, factor, baseline, forward, exact = rig
    middle = kind(axis)
    for i in range(len(column)):
        left, right = (middle - column[i]) * kind(factor), (middle - out[0, i]) * kind(factor)
        if exact:
            left, right = kind(math.atan(left)), kind(math.atan(right))
        valid[i] = valid[i] and right > left
        if valid[i]:
            distance = kind(baseline) * math.cos(right) / math.sin(right - left)
            out[0, i], out[1, i], out[2, i] = distance, left, right
            out[3, i] = kind(forward) + distance * math.cos(left)
            out[4, i] = kind(baseline / 2) + distance * math.sin(left)
        else:
            out[0, i] = out[1, i] = out[2, i] = out[3, i] = out[4, i] = 0
