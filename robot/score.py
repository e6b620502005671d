"""The scorer: what a drive was worth, measured against the true plan and the true path."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch

from ndtorch.navigation import Grid, StereoRig
from robot.sim.model import edge_columns
from robot.sim.plan import Floats, Plan

NEAR = 0.10
"""Metres from a true edge within which mass of the map counts as right."""

FAINTEST = 0.02
"""A peak of the map counts when it is at least this share of its largest."""


class MapScore(NamedTuple):
    """How good a map is; None where there is nothing to measure.

    Attributes:
        precision: share of the map's mass within 10 cm of a true edge.
        recall: share of the visible edges that have a peak of the map within 10 cm.
        position_error_cm: median distance from these edges to their peaks.
        spacing_error_percent: of the median distance between the peaks of neighbouring doors.
    """

    precision: float | None
    recall: float | None
    position_error_cm: float | None
    spacing_error_percent: float | None


def true_edges(plan: Plan, profiles: list[Floats]) -> Floats:
    """Vertical edges at the height of the cameras, `[E, 2]`: corners of walls, and jumps of their brightness."""
    places: list[tuple[float, float]] = []
    k = 0
    for shape in plan.rings:
        corners = shape.array
        ahead = np.roll(corners, -1, 0) - corners
        before = np.roll(ahead, 1, 0)
        bend = np.abs(np.arctan2(before[:, 0] * ahead[:, 1] - before[:, 1] * ahead[:, 0], (before * ahead).sum(1)))
        places += [(float(x), float(y)) for x, y in corners[bend > math.radians(15)]]
        for (x, y), (dx, dy) in zip(corners, ahead, strict=True):
            length = math.hypot(dx, dy)
            for s in edge_columns(profiles[k]):
                if 0.03 < s < length - 0.03:  # nearer ones are the corner itself
                    places.append((float(x + dx * s / length), float(y + dy * s / length)))
            k += 1
    return np.array(places)


def visible(plan: Plan, edges: Floats, poses: Floats, rig: StereoRig, times: int = 5) -> np.ndarray:
    """Which edges could be ranged from at least `times` of the poses `[T, 3]`: inside both images, within the
    window of disparities, nothing in front.
    """
    count = np.zeros(len(edges), dtype=np.int64)
    for x, y, heading in poses:
        ahead = (edges - (x, y)) @ np.array([math.cos(heading), math.sin(heading)]) - rig.forward
        aside = (edges - (x, y)) @ np.array([-math.sin(heading), math.cos(heading)])
        depth = np.where(ahead > 0.1, ahead, np.inf)
        disparity = rig.focal * rig.baseline / depth
        outer = rig.focal * (np.abs(aside) + rig.baseline / 2) / depth
        near = np.flatnonzero((disparity > 60) & (disparity < 200) & (outer < rig.width / 2 - 1))
        if len(near):
            eye = np.array([x + rig.forward * math.cos(heading), y + rig.forward * math.sin(heading)])
            count[near[plan.sees(eye, edges[near])]] += 1
    return count >= times


def peaks(cells: torch.Tensor, grid: Grid) -> Floats:
    """Places of the map's peaks `[P, 2]`: largest within 7 cm after smoothing over 5 cm."""
    pooled = torch.nn.functional.avg_pool2d(cells[None, None], 5, 1, 2)
    largest = torch.nn.functional.max_pool2d(pooled, 15, 1, 7)
    row, column = torch.nonzero(((pooled == largest) & (pooled > FAINTEST * pooled.max()))[0, 0], as_tuple=True)
    return torch.stack(grid.centre(row, column), -1).double().numpy()


def score_map(
    cells: torch.Tensor, grid: Grid, plan: Plan, profiles: list[Floats], poses: Floats, rig: StereoRig
) -> MapScore:
    """Compare a map with the truth.

    Args:
        cells: `[rows, columns]`.
        poses: true poses `[T, 3]`, some of each second.
    """
    edges = true_edges(plan, profiles)
    if float(cells.max()) <= 0:
        return MapScore(None, None, None, None)
    row, column = torch.nonzero(cells, as_tuple=True)
    mass = cells[row, column].double().numpy()
    places = torch.stack(grid.centre(row, column), -1).double().numpy()
    precision = float(mass[nearest(places, edges) <= NEAR].sum() / mass.sum())
    seen = edges[visible(plan, edges, poses, rig)]
    tops = peaks(cells, grid)
    if not len(seen) or not len(tops):
        return MapScore(precision, None, None, None)
    error = nearest(seen, tops)
    found = error <= NEAR
    position = float(np.median(error[found])) * 100 if found.any() else None
    return MapScore(precision, float(found.mean()), position, spacing_error(plan, tops))


def nearest(points: Floats, targets: Floats, chunk: int = 20000) -> Floats:
    """Distance of points `[N, 2]` to the nearest of targets `[M, 2]`."""
    result = np.full(len(points), np.inf)
    for k in range(0, len(points), chunk):
        part = points[k : k + chunk]
        best = np.full(len(part), np.inf)
        for x, y in targets:
            best = np.minimum(best, (part[:, 0] - x) ** 2 + (part[:, 1] - y) ** 2)
        result[k : k + chunk] = np.sqrt(best)
    return result


def spacing_error(plan: Plan, tops: Floats) -> float | None:
    """Error in percent of the median distance between peaks at the same corner of neighbouring doors."""
    found = []
    for row in plan.doors:
        corners = np.array(row)
        distance = np.hypot(corners[:, None, 0] - tops[None, :, 0], corners[:, None, 1] - tops[None, :, 1])
        mine = tops[distance.argmin(1)]
        good = distance.min(1) <= NEAR
        for k in range(len(corners) - 1):
            if good[k] and good[k + 1]:
                found.append(float(np.hypot(*(mine[k + 1] - mine[k]))))
    return abs(float(np.median(found)) / plan.spacing - 1) * 100 if found else None


def coverage(free: Floats, path: Floats, reach: float = 1.0) -> float:
    """Share of the free places `[N, 2]` that the car came within `reach` metres of."""
    thinned = path[:: max(1, 10)]
    return float((nearest(free, thinned) <= reach).mean())
