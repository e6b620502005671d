"""Kernels of the grid map: cells and certainties of beams, and sums of weights in tiles."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ndtorch.utils.jit import jit

Array = Any


class Rays(NamedTuple):
    """Angles of ranged features at both cameras and which of them are valid, `[n]` each, see `Ranges`."""

    left_angle: Array
    right_angle: Array
    valid: Array


class Samples(NamedTuple):
    """`BeamTable` as arrays: `[2, S]` and `[S]`."""

    tangent: Array
    weight: Array


class Beams(NamedTuple):
    """Baseline and place of the cameras ahead of the body's origin, m, and space constant of the beams, m."""

    baseline: float
    forward: float
    reach: float


class Lattice(NamedTuple):
    """x and y where cell 0 begins, side of a cell, m, and what rows and columns add to the index of a cell."""

    left: float
    bottom: float
    cell: float
    down: Array
    across: Array


@jit
def beam_cells(
    rays: Rays,
    samples: Samples,
    beams: Beams,
    pose: tuple[float, float, float],
    lattice: Lattice,
    numbers: Array,
    weights: Array,
) -> int:
    """Cells and certainties of one frame's features: `sample_certainty`, `to_world` and `GridMap.numbers` in one pass.

    Args:
        numbers, weights: filled with indices of cells and certainties per area, `[n * S]`.

    Returns:
        How many there are; features that are not valid have none.
    """
    kind, count = weights.dtype.type, 0
    nearest = kind(beams.baseline / 100.0)
    cos, sin = kind(math.cos(pose[2])), kind(math.sin(pose[2]))
    here, there = kind(pose[0]), kind(pose[1])
    begin, bottom, per = kind(lattice.left), kind(lattice.bottom), kind(1 / lattice.cell)
    last_row, last_column = kind(lattice.down.shape[0] - 1), kind(lattice.across.shape[0] - 1)
    scale = kind(1 / lattice.cell**2)
    for i in range(rays.valid.shape[0]):
        if not rays.valid[i]:
            continue
        left_tan, right_tan = kind(math.tan(rays.left_angle[i])), kind(math.tan(rays.right_angle[i]))
        for s in range(samples.weight.shape[0]):
            one, other = samples.tangent[0, s], samples.tangent[1, s]
            left = (left_tan + one) / (kind(1) - left_tan * one)
            right = (right_tan + other) / (kind(1) - right_tan * other)
            x = kind(beams.baseline) / max(right - left, nearest)
            far, near = left * left + kind(1), right * right + kind(1)
            falloff = kind(math.exp((kind(math.sqrt(far)) + kind(math.sqrt(near))) * x * kind(-1 / beams.reach)))
            weights[count] = falloff * (x * x * x * (far * near)) * samples.weight[s] * scale
            aside = left * x + kind(beams.baseline / 2)
            x += kind(beams.forward)
            column = min(max((here + cos * x - sin * aside - begin) * per, kind(0)), last_column)
            row = min(max((there + sin * x + cos * aside - bottom) * per, kind(0)), last_row)
            numbers[count] = lattice.down[int(row)] + lattice.across[int(column)]
            count += 1
    return count


@jit
def tile_sums(numbers: Array, weights: Array, slots: Array, tiles: Array) -> None:
    """Add weights to cells in place.

    Args:
        numbers: indices of cells, `[k]`, and their weights.
        slots: position in `tiles` of each tile of the grid, `[count]`.
        tiles: `[touched, cells of a tile]`.
    """
    cells = tiles.shape[1]
    for i in range(numbers.shape[0]):
        tile = numbers[i] // cells
        tiles[slots[tile], numbers[i] - tile * cells] += weights[i]
