"""Means over overlapping fields, taken row by row."""

from __future__ import annotations

from typing import Any

from ndtorch.utils.jit import jit

Array = Any


@jit
def add_row(values: Array, weights: Array, y: int, share: float, sums: Array) -> None:
    """Add a row of pixels to the rows of fields that it belongs to.

    Args:
        values: `[W]`.
        weights: of the rows of pixels in every row of fields, `[R, H]`; `y` is the number of this one.
        share: what the weights are multiplied by.
        sums: in every column of pixels, `[R, W]`.
    """
    for r in range(sums.shape[0]):
        weight = weights[r, y] * share
        if weight != 0:
            for x in range(values.shape[0]):
                sums[r, x] += weight * values[x]


@jit
def over_columns(sums: Array, weights: Array, fields: Array) -> None:
    """`sums weights'`: from columns of pixels `[R, W]` to those of fields `[R, C]`, with weights `[C, W]`."""
    for r in range(fields.shape[0]):
        for c in range(fields.shape[1]):
            total = sums.dtype.type(0)
            for x in range(sums.shape[1]):
                total += sums[r, x] * weights[c, x]
            fields[r, c] = total
