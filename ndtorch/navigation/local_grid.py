"""The rolling grid of evidence around a car, free distances along arcs, and the path to back out on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.body import Body
from ndtorch.utils.jit import jit

Array = Any
"""A NumPy array."""

Place = tuple[float, float, float]
"""x and y, m, and heading, radians."""

LINE_FROM, LINE_TO, LINE_PLACES = 0.15, 0.88, 24
"""From and up to which ratio of a range its line of sight counts as seen through, and how many points of it."""

BORDER = 1e-4
"""Points are moved by this ratio of a cell, so that one on a border is in the cell above it however it was rounded."""

SPACING, POSES, LOOKAHEAD_POSES = 0.05, 70, 4
"""Metres from one pose of the path to the next, how many are kept, and how many a car that goes back looks ahead."""

MAX_OFFSET_M, MAX_TURN_RAD, PASSED_M = 0.06, 0.25, 0.01
"""A car that backs farther beside the path than this, or is turned more against it, has left it; and the distance
before which a pose is passed."""


@dataclass(frozen=True)
class LocalGridParams:
    """A square of square cells that moves with the car."""

    cell_m: float = 0.08  # side of a cell
    size_cells: int = 64  # number of cells along a side, a power of two; what lies beyond is forgotten
    lifetime_s: float = 10.0  # time in which evidence falls to 1/e
    max_evidence: float = 5.0  # limit of the evidence of an obstacle, so that a few frames can free a cell
    # limit of the evidence of free floor, so that four frames can block a cell
    max_free_evidence: float = 2.0

    def __post_init__(self) -> None:
        check_numbers(self, endless=["lifetime_s"], positive=vars(self))
        if not (self.size_cells >= 2 and self.size_cells & (self.size_cells - 1) == 0):
            raise InputError(f"size_cells must be a power of two, got {self.size_cells}")

    @property
    def reach(self) -> float:
        """Points nearer than this along either axis are inside, m."""
        return (self.size_cells // 2 - 1) * self.cell_m


class LocalGrid(NamedTuple):
    """Evidence about the surroundings of one car."""

    # `[size, size]`, positive where something is, negative where floor was seen. A place is in the cell of
    # its world coordinates (in cells, rounded down) modulo `size`
    evidence: Array
    tag: Array  # `[2, size]`, which of the places that share a row or column it stands for
    # evidence of what is above floor that is seen, of the same places; `[0, 0]` where it is not kept apart
    raised: Array


class DrivenPath(NamedTuple):
    """Poses that one car has driven through forward, by dead reckoning."""

    poses: Array  # x, y in m and heading in radians, the newest first, `[POSES, 3]`
    size: int  # how many of them are valid


class Primitives(NamedTuple):
    """Places that the outline of the car passes along arcs, body frame."""

    curvature: Array  # of the arcs, 1/m, `[A]`
    forward: Array  # +1 or -1, `[A]`
    x: Array  # x, y: m, `[A * steps * P]`: P places of the outline at each step of an arc
    y: Array
    leading: int  # how many of the P are on the bumper that leads; they come first
    steps: int  # of each arc
    step: float  # distance between two, m


def empty_grid(x: float, y: float, params: LocalGridParams, raised: bool = False) -> LocalGrid:
    """Nothing is known around a car at x, y, m; what is raised may be kept apart."""
    size = params.size_cells
    above = np.zeros((size, size) if raised else (0, 0), np.float32)
    return LocalGrid(np.zeros((size, size), np.float32), tags(float(x), float(y), params.cell_m, size), above)


def unrolled(evidence: Array, x: float, y: float, params: LocalGridParams) -> tuple[Array, float, float]:
    """Evidence `[size, size]` as rows of y and columns of x around a point, both growing, and its lower left corner."""
    size, half = params.size_cells, params.size_cells // 2
    left, bottom = (math.floor(v / params.cell_m) - half + 1 for v in (x, y))
    cells = np.roll(evidence, (-left % size, -bottom % size), (0, 1)).T
    return np.ascontiguousarray(cells), left * params.cell_m, bottom * params.cell_m


def motion_primitives(
    arcs: list[tuple[float, int]],
    body: Body,
    margin: float,
    longest: float,
    step: float = 0.08,
    lag: float = 0.0,
) -> Primitives:
    """Outlines along arcs of (curvature, +1 forward or -1 backward).

    The bumper on the leading side and both flanks are followed; places are at most a step apart, so that no
    cell of that size is missed.

    Args:
        margin: kept free around the body, m.
        longest: of the arcs, m.
        lag: the car goes on straight for this long before its wheels have turned, m.
    """
    steps = round(longest / step)
    wide, ahead = body.width_m / 2 + margin, body.length_m / 2 + margin
    across = np.linspace(-wide, wide, math.ceil(2 * wide / step - 1e-9) + 1)
    flank = np.linspace(-ahead, ahead, math.ceil(2 * ahead / (2 * step)) + 1)[:-1]
    px = np.concatenate((np.full_like(across, ahead), flank, flank))
    py = np.concatenate((across, np.full_like(flank, wide), np.full_like(flank, -wide)))
    s = step * np.arange(1, steps + 1)
    # Driving backward along an arc mirrors the path that driving forward along it takes.
    curvature, direction = np.array(arcs).T[:, :, None]
    bent = (s - lag).clip(min=0.0)
    turned = curvature * bent
    chord = bent * np.sinc(turned / 2 / math.pi)
    x, y = s - bent + chord * np.cos(turned / 2), chord * np.sin(turned / 2)
    cos, sin = np.cos(turned)[..., None], np.sin(turned)[..., None]
    xs = direction[..., None] * (x[..., None] + cos * px - sin * py)
    places = curvature, direction, xs, y[..., None] + sin * px + cos * py
    bends, forward, xs, ys = (part.ravel().astype(np.float32) for part in places)
    return Primitives(bends, forward, xs, ys, len(across), steps, step)


@jit
def in_cells(pose: Place, cell: float) -> tuple[float, float, float, float]:
    """Cosine and sine of a heading, and x and y of a pose, all over the side of a cell."""
    return math.cos(pose[2]) / cell, math.sin(pose[2]) / cell, pose[0] / cell + BORDER, pose[1] / cell + BORDER


@jit
def cell_of(x: float, y: float, pose: tuple[float, float, float, float], size: int) -> tuple[int, int]:
    """Row and column of the cell that holds a point of the body frame, m, for a pose of `in_cells`."""
    cos, sin, ahead, aside = pose
    row, column = math.floor(cos * x - sin * y + ahead), math.floor(sin * x + cos * y + aside)
    return row & (size - 1), column & (size - 1)


@jit
def cell_index(x: Array, y: Array, pose: Place, cell: float, size: int) -> Array:
    """Numbers, row after row, of the cells that hold points `[n]` of the body frame."""
    here, at = in_cells(pose, cell), np.empty(x.shape[0], np.int32)
    for k in range(at.shape[0]):
        row, column = cell_of(x[k], y[k], here, size)
        at[k] = row * size + column
    return at


@jit
def tags(x: float, y: float, cell: float, size: int) -> Array:
    """How often each row and column has been wrapped around for a car at x, y, `[2, size]`."""
    out, rows = np.empty((2, size), np.float32), np.arange(size)
    out[0] = np.floor((math.floor(x / cell) - rows) / size + 0.5)
    out[1] = np.floor((math.floor(y / cell) - rows) / size + 0.5)
    return out


@jit
def move_grid(grid: LocalGrid, pose: Place, cell: float, keep: float) -> LocalGrid:
    """Forget what has left the square, and of the rest all but the ratio `keep`."""
    size = grid.tag.shape[1]
    tag = tags(pose[0], pose[1], cell, size)
    same = (tag == grid.tag).astype(np.float32)
    kept = same[0].reshape(size, 1) * same[1] * np.float32(keep)
    return LocalGrid(grid.evidence * kept, tag, grid.raised * kept if grid.raised.size else grid.raised)


@jit
def bound(evidence: Array, least: float, most: float) -> None:
    evidence[:] = np.minimum(np.maximum(evidence, np.float32(least)), np.float32(most))


@jit
def add_ranges(
    evidence: Array,
    ranges: tuple[Array, Array, Array],
    pose: Place,
    numbers: Array,
    weight: float,
    miss: float,
) -> None:
    """Add ranges, and take evidence from the cells between the car and each of them, without bounds.

    Args:
        evidence: `[size, size]`, changed in place.
        ranges: x and y, m, and valid, `[n]`, body frame.
        numbers: packed, with `cell_m`, `reach`, `forward`, `beam_left` and `points_per_m`.
        weight, miss: evidence of a range, and what it takes from each cell of its line of sight.
    """
    p, size, here = numbers[0], evidence.shape[0], in_cells(pose, numbers[0].cell_m)
    x, y, valid = ranges
    for i in range(x.shape[0]):
        if not valid[i]:
            continue
        if max(abs(x[i]), abs(y[i])) < p.reach:
            evidence[cell_of(x[i], y[i], here, size)] += weight
        if miss > 0:
            dx, dy = x[i] - p.forward, y[i] - p.beam_left
            # Those of its points that share a cell take that much together.
            taken = miss * min(math.hypot(dx, dy) * p.points_per_m, 1.0)
            for k in range(LINE_PLACES):
                ratio = LINE_FROM + k * (LINE_TO - LINE_FROM) / (LINE_PLACES - 1)
                at = cell_of(p.forward + dx * ratio, p.beam_left + dy * ratio, here, size)
                evidence[at] -= taken


@jit
def costs(grid: LocalGrid, blocked: float) -> Array:
    """Evidence in which what is raised blocks, `[size, size]`."""
    if not grid.raised.size:
        return grid.evidence
    limit = np.float32(blocked)
    return np.where(grid.raised >= limit, np.maximum(grid.evidence, limit), grid.evidence)


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
    blocks, hides = np.float32(blocked), np.float32(unknown)  # as evidence is rounded
    for arc in range(count):
        free, seen, stop, hidden = 0, 0, False, False
        looked = arcs.leading if arcs.forward[arc] > 0 else across
        for s in range(arcs.steps):
            start = (arc * arcs.steps + s) * across
            for k in range(across):
                if stop and (hidden or k >= looked):
                    break
                worth = cells[at[start + k]]
                stop = stop or worth >= blocks
                hidden = hidden or (k < looked and worth >= hides)
            free, seen = free + (not stop), seen + (not hidden)
            if stop and hidden:
                break
        out[0, arc] = free * arcs.step
        out[1, arc] = seen * arcs.step
    return out


@jit
def record(path: DrivenPath, pose: Place, speed: float) -> DrivenPath:
    """The path after a step: forward it grows, and going back takes off what is passed.

    A car that goes back beside it has left the path, and begins another one there.
    """
    poses, last = path.poses.copy(), path.poses[0]
    cos, sin, ahead, aside = math.cos(pose[2]), math.sin(pose[2]), last[0] - pose[0], last[1] - pose[1]
    x, y = cos * ahead + sin * aside, cos * aside - sin * ahead
    left = abs(y) > MAX_OFFSET_M or abs(last[2] - pose[2]) > MAX_TURN_RAD
    begins = path.size < 1 or (speed < -1e-3 and left)
    if begins or (speed > 0 and math.hypot(x, y) >= SPACING):
        poses[1:] = path.poses[:-1]
        poses[0, 0], poses[0, 1], poses[0, 2] = pose
        return DrivenPath(poses, 1 if begins else min(path.size + 1, POSES))
    if speed <= 0 and x > -PASSED_M:
        poses[:-1] = path.poses[1:]
        return DrivenPath(poses, path.size - 1)
    return DrivenPath(poses, path.size)


@jit
def pure_pursuit_back(path: DrivenPath, pose: Place, max_curvature: float) -> tuple[float, float]:
    """How far the path leads back, m, and the curvature of the arc to a point 0.2 m behind on it [Coulter 1992]."""
    steps = max(path.size - 1, 0)
    at = path.poses[min(steps, LOOKAHEAD_POSES)]
    cos, sin, ahead, aside = math.cos(pose[2]), math.sin(pose[2]), at[0] - pose[0], at[1] - pose[1]
    x, y = cos * ahead + sin * aside, cos * aside - sin * ahead
    bend = min(max(2 * y / max(x * x + y * y, 0.01), -max_curvature), max_curvature)
    return steps * SPACING, bend if x < -2 * PASSED_M else 0.0
