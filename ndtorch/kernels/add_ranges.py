"""Ranges that come between steps, into what stands around one car."""

from __future__ import annotations

from typing import Any

from ndtorch.kernels.patch_arcs import remember_ranges, turning
from ndtorch.utils.jit import jit

Array = Any


@jit
def add_ranges(
    standing: Array,
    pose: tuple[float, float, float],
    ranges: tuple[Array, Array, Array],
    found: tuple[float, float],
    line: Array,
    under: Array,
    beam: tuple[float, float, float, float],
    cell: float,
    bounds: tuple[float, float],
) -> None:
    """`remember_ranges` of `ndtorch.navigation.controllers.ranging.overhangs` into `standing`, `[size, size]`.

    Args:
        standing: of the patch of a car that is at `pose`.
        ranges: x, y and valid, `[n]`.
        found, line, under, beam: of `remember_ranges`.
        cell, bounds: of `patch_arcs`.
    """
    kind = standing.dtype.type
    remember_ranges(standing, ranges, turning(pose, cell, standing), found, line, under, beam, 0.0)
    least, most = kind(bounds[0]), kind(bounds[1])
    for row in range(standing.shape[0]):
        for column in range(standing.shape[1]):
            standing[row, column] = min(max(standing[row, column], least), most)
