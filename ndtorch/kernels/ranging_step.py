"""A whole step of a car with the ranging controller: from the pixels to the command."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from ndtorch.kernels.arc import arc
from ndtorch.kernels.cell_maxima import cell_maxima
from ndtorch.kernels.load import FAST
from ndtorch.kernels.match_cells import match_cells
from ndtorch.kernels.ranging_control import ranging_control
from ndtorch.kernels.row_ranges import row_ranges
from ndtorch.kernels.strips import larger

Array = Any

largest_in_cells = numba.njit(fastmath=FAST, error_model="numpy")(cell_maxima)
matched = numba.njit(fastmath=FAST, error_model="numpy")(match_cells)
ranged = numba.njit(fastmath=FAST, error_model="numpy")(row_ranges)
driven = numba.njit(error_model="numpy")(arc)
controlled = numba.njit(error_model="numpy")(ranging_control)


def ranging_step(
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
    size: tuple[int, int, int],
    match: tuple[Array, Array, tuple[int, int], int, int, float, float],
    memory: tuple[Array, Array, Array],
    new_memory: tuple[Array, Array, Array],
    tables: tuple[Array, Array, Array, Array],
    floor: tuple[float, ...],
    worths: tuple[float, float, float],
    patch: tuple[float, float, float, float, float, float, float, float, float],
    arcs: tuple[int, int, int, float],
    choice: tuple[Array, Array, Array],
    limits: tuple[float, ...],
) -> tuple[float, float]:
    """The step of `Navigator` of one car and one frame: arguments and result as of `published_step`.

    Args:
        size: `every` of `cell_maxima`, blocks of cells, and columns of the fields, every so many of them.
        match: the tables of `match_cells`.
        memory: and the rest are those of `ranging_control`.
    """
    unit, count = grey
    tops, lefts = (where[0], where[1]), (where[2], where[3])
    bands, blocks = memory[0].size, size[1]
    every = size[0]
    found, seen = np.empty((2, bands, blocks), low[0].dtype), np.empty((4, bands, blocks), low[0].dtype)
    rows_compared, shift, first, wide, tall, alike, least = match
    cells = (lefts[0] + every * first[0], lefts[1] + every * first[1])
    largest_in_cells(fields, beside[0], tops, cells, every, unit, count, settle, low[0], shares[0], new_low[0], found)
    matched(
        fields,
        beside[0],
        tops,
        lefts,
        every,
        unit,
        count,
        size[2],
        rows_compared,
        shift,
        first,
        wide,
        tall,
        alike,
        least,
        seen[2:],
    )
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
    peak = sides.dtype.type(0)
    for eye in range(2):
        highest = sides.dtype.type(0)
        for band in range(bands):
            for block in range(blocks):
                # The nearest band is the first, and the outermost block too.
                worth = found[eye, bands - 1 - band, blocks - 1 - block if eye else block]
                highest = larger(worth, highest)
                seen[eye, band, block] = worth * sides.dtype.type(step[3])
        peak = larger(highest, peak)
        sides[eye] = highest * sides.dtype.type(step[3])
    now = np.empty(numbers.size, numbers.dtype)
    for k in range(now.size):
        now[k] = numbers[k]
    x, y, heading = driven(float(now[2]), float(now[3]), float(now[4]), float(now[0]) * step[2], float(now[1]), step[0])
    now[2], now[3], now[4] = x, y, heading + step[1]
    after[2], after[3], after[4] = now[2], now[3], now[4]
    controlled(
        seen,
        (out[3], out[4], valid),
        now,
        memory,
        new_memory,
        after,
        tables,
        floor,
        worths,
        patch,
        arcs,
        choice,
        limits,
    )
    return float(peak), largest
