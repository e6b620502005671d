"""Compiled: the rolling grid of evidence, free distances along motion primitives, and the path to back out on."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ndtorch.utils.jit import jit

Array = Any
"""A NumPy array."""


class LocalGrid(NamedTuple):
    """Evidence about the surroundings of one car.

    Attributes:
        evidence: `[size, size]`, positive where something is, negative where floor was seen. A place is in the cell of
            its world coordinates (in cells, rounded down) modulo `size`.
        tag: `[2, size]`, which of the places that share a row or column it stands for.
        raised: evidence of what is above floor that is seen, of the same places; `[0, 0]` where it is not kept apart.
    """

    evidence: Array
    tag: Array
    raised: Array


class DrivenPath(NamedTuple):
    """Poses that one car has driven through forward, by dead reckoning.

    Attributes:
        poses: x, y in m and heading in radians, the newest first, `[POSES, 3]`.
        size: how many of them are valid.
    """

    poses: Array
    size: int


class GridNumbers(NamedTuple):
    """What updates a `LocalGrid`.

    Attributes:
        cell: side of a cell, m.
        keep, fade: shares of the evidence that stay after a step, as a rule and while the car is boxed in.
        reach: ranges nearer than this along both axes are added, m.
        least, most: bounds of the evidence of a cell.
        range_weight: evidence of a range.
        blocked, unknown: evidence from which a cell blocks, and from which it was not seen free.
        beam_forward, beam_left: origin of the lines of sight, m.
        miss, seen_through: evidence that a range takes from each cell before it, in `raised` and in `evidence`.
        cells_per_m: cells between two places of a line of sight, for each metre of range.
    """

    cell: float
    keep: float
    fade: float
    reach: float
    least: float
    most: float
    range_weight: float
    blocked: float
    unknown: float
    beam_forward: float
    beam_left: float
    miss: float
    seen_through: float
    cells_per_m: float


class Primitives(NamedTuple):
    """Places that the outline of the car passes along arcs, body frame.

    Attributes:
        curvature: of the arcs, 1/m, `[A]`.
        forward: +1 or -1, `[A]`.
        x, y: m, `[A * steps * P]`: P places of the outline at each step of an arc.
        leading: how many of the P are on the bumper that leads; they come first.
        steps: of each arc.
        step: distance between two, m.
    """

    curvature: Array
    forward: Array
    x: Array
    y: Array
    leading: int
    steps: int
    step: float


class Turn(NamedTuple):
    """A pose in cells: cosine and sine of the heading over the side of a cell, and the place."""

    cos: Any
    sin: Any
    x: Any
    y: Any


@jit(exact=True)
def turn_of(pose: tuple[float, float, float], cell: float) -> Turn:
    kind = np.float32
    cos, sin = kind(math.cos(kind(pose[2]))) / kind(cell), kind(math.sin(kind(pose[2]))) / kind(cell)
    return Turn(cos, sin, kind(pose[0]) / kind(cell), kind(pose[1]) / kind(cell))


@jit(exact=True)
def cell_of(x: float, y: float, turn: Turn, size: int) -> tuple[int, int]:
    """Row and column of the cell that holds a place of the body frame."""
    row = math.floor(turn.cos * x - turn.sin * y + turn.x)
    column = math.floor(turn.sin * x + turn.cos * y + turn.y)
    return int(row) & (size - 1), int(column) & (size - 1)


@jit(exact=True)
def cell_index(x: Array, y: Array, pose: tuple[float, float, float], cell: float, size: int) -> Array:
    """Numbers, row after row, of the cells that hold places `[n]` of the body frame."""
    turn, at = turn_of(pose, cell), np.empty(x.shape[0], np.int32)
    cos, sin, ahead, aside = turn.cos, turn.sin, turn.x, turn.y
    last, side = np.int32(size - 1), np.int32(size)
    for k in range(at.shape[0]):
        row = np.int32(np.floor(cos * x[k] - sin * y[k] + ahead)) & last
        column = np.int32(np.floor(sin * x[k] + cos * y[k] + aside)) & last
        at[k] = row * side + column
    return at


@jit(exact=True)
def tags(x: float, y: float, cell: float, size: int) -> Array:
    """How often each row and column has been wrapped around for a car at x, y, `[2, size]`."""
    out, kind = np.empty((2, size), np.float32), np.float32
    rows = np.arange(size).astype(kind)
    for axis in range(2):
        here = math.floor(kind(y if axis else x) / kind(cell))
        out[axis] = np.floor((kind(here) - rows) / kind(size) + kind(0.5))
    return out


@jit(exact=True)
def moved(evidence: Array, tag: Array, new_tag: Array, keep: float) -> Array:
    """Evidence of the cells that still represent the same places, of which the share `keep` stays; else 0."""
    kind, size = np.float32, evidence.shape[0]
    out, same = np.empty_like(evidence), np.empty(size, np.float32)
    for n in range(size):
        same[n] = kind(new_tag[1, n] == tag[1, n])
    for row in range(size):
        kept = kind(keep) if new_tag[0, row] == tag[0, row] else kind(0)
        for column in range(size):
            out[row, column] = evidence[row, column] * (kept * same[column])
    return out


@jit
def move_grid(grid: LocalGrid, pose: tuple[float, float, float], cell: float, keep: float) -> LocalGrid:
    """Forget what has left the square, and of the rest all but the share `keep`."""
    tag = tags(pose[0], pose[1], cell, grid.tag.shape[1])
    raised = moved(grid.raised, grid.tag, tag, keep) if grid.raised.size else grid.raised
    return LocalGrid(moved(grid.evidence, grid.tag, tag, keep), tag, raised)


@jit
def bound(evidence: Array, least: float, most: float) -> None:
    low, high = np.float32(least), np.float32(most)
    for row in range(evidence.shape[0]):
        for column in range(evidence.shape[1]):
            evidence[row, column] = min(max(evidence[row, column], low), high)


@jit(exact=True)
def add_ranges(
    evidence: Array,
    ranges: tuple[Array, Array, Array],
    pose: tuple[float, float, float],
    numbers: GridNumbers,
    weight: float,
    miss: float,
) -> None:
    """Add ranges, and take evidence from the cells between the car and each of them, without bounds.

    Args:
        evidence: `[size, size]`, changed in place.
        ranges: x and y, m, and valid, `[n]`, body frame.
        weight, miss: evidence of a range, and what it takes from each cell of its line of sight.
    """
    kind, size, turn = np.float32, evidence.shape[0], turn_of(pose, numbers.cell)
    ahead, aside = kind(numbers.beam_forward), kind(numbers.beam_left)
    x, y, valid = ranges
    for i in range(x.shape[0]):
        if not valid[i]:
            continue
        if max(abs(x[i]), abs(y[i])) < kind(numbers.reach):
            row, column = cell_of(x[i], y[i], turn, size)
            evidence[row, column] += kind(weight)
        if miss > 0:
            dx, dy = x[i] - ahead, y[i] - aside
            # Those of its places that share a cell take that much together.
            taken = kind(miss) * min(kind(math.hypot(dx, dy)) * kind(numbers.cells_per_m), kind(1))
            for k in range(LINE_PLACES):
                share = kind(LINE_FROM + k * (LINE_TO - LINE_FROM) / (LINE_PLACES - 1))
                row, column = cell_of(ahead + dx * share, aside + dy * share, turn, size)
                evidence[row, column] -= taken


LINE_FROM, LINE_TO, LINE_PLACES = 0.15, 0.88, 24
"""From and up to which share of a range its line of sight counts as seen through, and how many places of it."""


@jit
def costs(grid: LocalGrid, blocked: float) -> Array:
    """Evidence in which what is raised blocks, `[size, size]`."""
    if not grid.raised.size:
        return grid.evidence
    out, limit = np.empty_like(grid.evidence), np.float32(blocked)
    for row in range(out.shape[0]):
        for column in range(out.shape[1]):
            own = grid.evidence[row, column]
            out[row, column] = max(own, limit) if grid.raised[row, column] >= limit else own
    return out


@jit
def free_distances(cost: Array, at: Array, arcs: Primitives, blocked: float, unknown: float) -> Array:
    """How far the car can go along each arc, `[2, A]` m in whole steps.

    First, before any place of its outline holds `blocked` or more: there something is in the path. Second, before a
    place of the bumper that leads, or backward of the whole outline, holds `unknown` or more: what is there was not
    seen free.

    Args:
        cost: `[size, size]`.
        at: cells of the places of the arcs, `[A * steps * P]`.
    """
    count, cells = arcs.curvature.shape[0], cost.reshape(-1)
    out, across = np.empty((2, count), np.float32), at.shape[0] // (count * arcs.steps)
    for arc in range(count):
        free, seen, stop, hidden = 0, 0, False, False
        looked = arcs.leading if arcs.forward[arc] > 0 else across
        for s in range(arcs.steps):
            start = (arc * arcs.steps + s) * across
            for k in range(across):
                if stop and (hidden or k >= looked):
                    break
                worth = cells[at[start + k]]
                stop = stop or worth >= np.float32(blocked)
                hidden = hidden or (k < looked and worth >= np.float32(unknown))
            free, seen = free + (not stop), seen + (not hidden)
            if stop and hidden:
                break
        out[0, arc] = np.float32(free) * np.float32(arcs.step)
        out[1, arc] = np.float32(seen) * np.float32(arcs.step)
    return out


SPACING = 0.05
"""Metres from one pose of the path to the next."""

POSES = 70
"""How many are kept: 3.5 m."""

LOOKAHEAD_POSES = 4
"""The car that goes back steers towards the pose so many behind the last."""

MAX_OFFSET_M, MAX_TURN_RAD = 0.06, 0.25
"""A car that backs farther beside the path than this, or is turned more against it, has left it."""

PASSED_M = 0.01
"""Metres before which a pose is passed; and twice that is too near to steer towards."""

NEAREST_SQUARED = 0.01
"""The square of the nearest distance, m^2, for which a curvature is worked out."""


@jit(exact=True)
def record(path: DrivenPath, pose: tuple[float, float, float], speed: float) -> DrivenPath:
    """The path after a step: forward it grows, and going back takes off what is passed.

    A car that goes back beside it has left the path, and begins another one there.
    """
    kind, poses, last = np.float32, np.empty_like(path.poses), path.poses[0]
    here = (kind(pose[0]), kind(pose[1]), kind(pose[2]))
    cos, sin = math.cos(here[2]), math.sin(here[2])
    ahead, aside = last[0] - here[0], last[1] - here[1]
    x, y = cos * ahead + sin * aside, cos * aside - sin * ahead
    first = path.size < 1
    turned = abs(last[2] - here[2]) > kind(MAX_TURN_RAD)
    off = not first and speed < kind(-1e-3) and (abs(y) > kind(MAX_OFFSET_M) or turned)
    passed = not first and not off and speed <= 0 and x > kind(-PASSED_M)
    far = not first and speed > 0 and math.hypot(x, y) >= kind(SPACING)
    shift = 1 if first or off or far else -1 if passed else 0
    for n in range(POSES):
        for k in range(3):
            poses[n, k] = path.poses[min(max(n - shift, 0), POSES - 1), k]
    if shift == 1:
        poses[0, 0], poses[0, 1], poses[0, 2] = here
    return DrivenPath(poses, 1 if first or off else min(path.size + shift, POSES))


@jit(exact=True)
def pure_pursuit_back(path: DrivenPath, pose: tuple[float, float, float], max_curvature: float) -> tuple[float, float]:
    """How far the path leads back, m, and the curvature of the arc to a place 0.2 m behind on it [Coulter 1992]."""
    kind = np.float32
    at = min(max(path.size - 1, 0), LOOKAHEAD_POSES)
    cos, sin = math.cos(kind(pose[2])), math.sin(kind(pose[2]))
    ahead, aside = path.poses[at, 0] - kind(pose[0]), path.poses[at, 1] - kind(pose[1])
    x, y = cos * ahead + sin * aside, cos * aside - sin * ahead
    bend = kind(2) * y / max(x * x + y * y, kind(NEAREST_SQUARED))
    bend = min(max(bend, kind(-max_curvature)), kind(max_curvature))
    length = float(kind(max(path.size - 1, 0)) * kind(SPACING))
    return length, float(bend) if x < kind(-2 * PASSED_M) else 0.0
