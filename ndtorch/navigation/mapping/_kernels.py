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


class MapTables(NamedTuple):
    """`BeamTable` as arrays, `[2, S]` and `[S]`, and what each row and column adds to the index of a cell."""

    tangent: Array
    weight: Array
    down: Array
    across: Array


class MapNumbers(NamedTuple):
    """Baseline and place of the cameras ahead of the body's origin, m, space constant of the beams, m, x and y where
    cell 0 begins, and side of a cell, m."""

    baseline: float
    forward: float
    reach: float
    left: float
    bottom: float
    cell: float


@jit
def beam_cells(
    rays: Rays, pose: tuple[float, float, float], tables: MapTables, map_numbers: Array, numbers: Array, weights: Array
) -> int:
    """Cells and certainties of one frame's features: `sample_certainty`, `to_world` and `GridMap.numbers` in one pass.

    Args:
        map_numbers: `packed` `MapNumbers`.
        numbers, weights: filled with indices of cells and certainties per area, `[n * S]`.

    Returns:
        How many there are; features that are not valid have none. -1 where an angle or the pose is not finite.
    """
    kind, count, m = weights.dtype.type, 0, map_numbers[0]
    baseline, forward, decay, half = kind(m.baseline), kind(m.forward), kind(-1 / m.reach), kind(m.baseline / 2)
    nearest = kind(m.baseline / 100.0)
    cos, sin = kind(math.cos(pose[2])), kind(math.sin(pose[2]))
    here, there = kind(pose[0]), kind(pose[1])
    begin, bottom, per = kind(m.left), kind(m.bottom), kind(1 / m.cell)
    last_row, last_column = kind(tables.down.shape[0] - 1), kind(tables.across.shape[0] - 1)
    scale = kind(1 / m.cell**2)
    if not math.isfinite(here + there + cos):
        return -1
    for i in range(rays.valid.shape[0]):
        if not rays.valid[i]:
            continue
        if not math.isfinite(rays.left_angle[i] + rays.right_angle[i]):
            return -1
        left_tan, right_tan = kind(math.tan(rays.left_angle[i])), kind(math.tan(rays.right_angle[i]))
        for s in range(tables.weight.shape[0]):
            one, other = tables.tangent[0, s], tables.tangent[1, s]
            left = (left_tan + one) / (kind(1) - left_tan * one)
            right = (right_tan + other) / (kind(1) - right_tan * other)
            x = baseline / max(right - left, nearest)
            far, near = left * left + kind(1), right * right + kind(1)
            falloff = kind(math.exp((kind(math.sqrt(far)) + kind(math.sqrt(near))) * x * decay))
            weights[count] = falloff * (x * x * x * (far * near)) * tables.weight[s] * scale
            aside = left * x + half
            x += forward
            column = min(max((here + cos * x - sin * aside - begin) * per, kind(0)), last_column)
            row = min(max((there + sin * x + cos * aside - bottom) * per, kind(0)), last_row)
            numbers[count] = tables.down[int(row)] + tables.across[int(column)]
            count += 1
    return count


@jit
def touched_tiles(numbers: Array, cells: int, slots: Array, touched: Array) -> int:
    """Number the tiles that hold cells of these indices; returns how many there are.

    Args:
        numbers: indices of cells, `[k]`; a tile has so many `cells`.
        slots: `[count]`, -1 for every tile of the grid; becomes the number of those that are touched.
        touched: becomes the tiles in the order of their numbers.
    """
    found = 0
    for i in range(numbers.shape[0]):
        tile = numbers[i] // cells
        if slots[tile] < 0:
            slots[tile] = found
            touched[found] = tile
            found += 1
    return found


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
