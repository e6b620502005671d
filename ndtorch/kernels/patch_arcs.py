"""What is remembered around the car, and how far it can go along its arcs."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ndtorch.utils.jit import jit

Array = Any


@jit
def patch_arcs(
    evidence: Array,
    tag: Array,
    pose: tuple[float, float, float],
    keep: float,
    ranges: tuple[Array, Array, Array],
    reach: float,
    weight: float,
    places: Array,
    weights: Array,
    stands: tuple[Array, Array, Array, int, tuple[float, float, float, float]],
    cell: float,
    bounds: tuple[float, float],
    limits: tuple[float, float],
    leading: int,
    steps: int,
    step: float,
    new_evidence: Array,
    new_tag: Array,
    lengths: Array,
) -> None:
    """`move_patch`, `add_evidence`, `remember_ranges` and `free_travel` of one car.

    Args:
        evidence, tag: of `Patch` before, `[size, size]` and `[2, size]`; `new_` after.
        keep: share of the evidence that is not forgotten.
        ranges: x, y and valid, `[n]`; those nearer than `reach` count `weight`.
        places: body frame, `[2, K]`: first those of `weights`, then those along the arcs.
        stands: what stands above floor before, `[size, size]` or `[0, 0]` where it is not remembered apart, and
            after; the rest is of `remember_ranges`.
        cell: side of a cell, m.
        bounds: least and most evidence of a cell.
        limits: evidence that blocks, and that is not known to be floor.
        leading, steps, step: of `ArcTable`.
        lengths: of the arcs up to what blocks, and up to what is not known, `[2, arcs]`.
    """
    kind, size = evidence.dtype.type, evidence.shape[0]
    retag(pose, kind(cell), new_tag)
    move(evidence, tag, kind(keep), new_evidence, new_tag)
    turn = turning(pose, cell, evidence)
    for i in range(ranges[0].shape[0]):
        x, y = ranges[0][i], ranges[1][i]
        if ranges[2][i] and max(abs(x), abs(y)) < kind(reach):
            row, column = find(x, y, turn, size)
            new_evidence[row, column] += kind(weight)
    marked, cells = weights.shape[0], new_evidence.reshape(-1)
    at = np.empty(places.shape[1], np.int32)
    find_all(places[0], places[1], turn, size, at)
    for i in range(marked):
        if weights[i] != 0:
            cells[at[i]] += weights[i]
    least, most = kind(bounds[0]), kind(bounds[1])
    for row in range(size):
        for column in range(size):
            new_evidence[row, column] = min(max(new_evidence[row, column], least), most)
    upright, standing, line, under, beam = stands
    worths = cells
    if upright.size:
        move(upright, tag, kind(keep), standing, new_tag)
        remember_ranges(standing, ranges, turn, (reach, weight), line, at[marked - under : marked], beam, -least)
        worths = np.empty(cells.size, cells.dtype)
        in_the_way(cells, standing.reshape(-1), (least, most), kind(limits[0]), worths)
    arcs = lengths.shape[1]
    across = (places.shape[1] - marked) // (arcs * steps)
    for arc in range(arcs):
        free, seen, blocked, unknown = 0, 0, False, False
        for s in range(steps):
            start = marked + (arc * steps + s) * across
            for k in range(across):
                if blocked and (unknown or k >= leading):
                    break
                worth = worths[at[start + k]]
                blocked = blocked or worth >= kind(limits[0])
                unknown = unknown or (k < leading and worth >= kind(limits[1]))
            free, seen = free + (not blocked), seen + (not unknown)
            if blocked and unknown:
                break
        lengths[0, arc], lengths[1, arc] = kind(free) * kind(step), kind(seen) * kind(step)


@jit(exact=True)
def turning(pose: tuple[float, float, float], cell: float, like: Array) -> tuple[float, float, float, float]:
    """Cosine and sine of the heading, and the place, in cells."""
    kind = like.dtype.type
    cos, sin = kind(math.cos(kind(pose[2]))) / kind(cell), kind(math.sin(kind(pose[2]))) / kind(cell)
    return cos, sin, kind(pose[0]) / kind(cell), kind(pose[1]) / kind(cell)


@jit(exact=True)
def find(x: float, y: float, turn: tuple[float, float, float, float], size: int) -> tuple[int, int]:
    """The cell that holds a place of the body frame."""
    cos, sin, ahead, aside = turn
    row, column = math.floor(cos * x - sin * y + ahead), math.floor(sin * x + cos * y + aside)
    return int(row) & (size - 1), int(column) & (size - 1)


@jit(exact=True)
def find_all(x: Array, y: Array, turn: tuple[float, float, float, float], size: int, at: Array) -> None:
    """Numbers of the cells that hold places, row after row; whole numbers of 32 bits become vector instructions."""
    cos, sin, ahead, aside = turn
    whole = np.int32
    last, side = whole(size - 1), whole(size)
    for k in range(at.shape[0]):
        row = whole(np.floor(cos * x[k] - sin * y[k] + ahead)) & last
        column = whole(np.floor(sin * x[k] + cos * y[k] + aside)) & last
        at[k] = row * side + column


@jit(exact=True)
def retag(pose: tuple[float, float, float], cell: float, new_tag: Array) -> None:
    """`tags`."""
    kind, size = new_tag.dtype.type, new_tag.shape[1]
    for axis in range(2):
        here = math.floor(kind(pose[axis]) / cell)
        for n in range(size):
            new_tag[axis, n] = math.floor((kind(here) - kind(n)) / kind(size) + kind(0.5))


@jit(exact=True)
def move(evidence: Array, tag: Array, keep: float, new_evidence: Array, new_tag: Array) -> None:
    """`move_patch` of one kind of evidence."""
    kind, size = evidence.dtype.type, evidence.shape[0]
    same = np.empty(size, evidence.dtype)
    for n in range(size):
        same[n] = kind(new_tag[1, n] == tag[1, n])
    for row in range(size):
        kept = keep if new_tag[0, row] == tag[0, row] else kind(0)
        for column in range(size):
            new_evidence[row, column] = evidence[row, column] * (kept * same[column])


@jit(exact=True)
def remember_ranges(
    standing: Array,
    ranges: tuple[Array, Array, Array],
    turn: tuple[float, float, float, float],
    found: tuple[float, float],
    line: Array,
    under: Array,
    beam: tuple[float, float, float, float],
    least: float,
) -> None:
    """`remember_ranges` into `standing`, which has been moved, before its bounds.

    Args:
        found: ranges nearer than the first count the second.
        line: shares of a range that are its line of sight.
        under: numbers of the cells below the car, from each of which `least` is taken.
        beam: place of the left eye ahead and aside, m; how much a line takes from each of its places, and how many
            cells a metre of range has between two of them.
    """
    kind, size, cells = standing.dtype.type, standing.shape[0], standing.reshape(-1)
    ahead, aside = kind(beam[0]), kind(beam[1])
    for i in range(ranges[0].shape[0]):
        x, y = ranges[0][i], ranges[1][i]
        if not ranges[2][i]:
            continue
        if max(abs(x), abs(y)) < kind(found[0]):
            row, column = find(x, y, turn, size)
            standing[row, column] += kind(found[1])
        x, y = x - ahead, y - aside
        miss = kind(beam[2]) * min(kind(math.hypot(x, y)) * kind(beam[3]), kind(1))
        for k in range(line.shape[0]):
            row, column = find(ahead + x * line[k], aside + y * line[k], turn, size)
            standing[row, column] -= miss
    for k in range(under.shape[0]):
        cells[under[k]] -= least


@jit(exact=True)
def in_the_way(cells: Array, standing: Array, bounds: tuple[float, float], blocked: float, worths: Array) -> None:
    """`in_the_way` of evidence and of what stands, which is brought within its bounds."""
    for k in range(cells.size):
        stands = min(max(standing[k], bounds[0]), bounds[1])
        standing[k] = stands
        worths[k] = max(cells[k], blocked) if stands >= blocked else cells[k]
