"""Metrics of a drive against the true plan and the true path."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch

from ndtorch.navigation import Grid, StereoRig
from ndtorch.navigation.stereo.features import MatchParams
from ndtorch_robot.sim.plan import Floats, Plan, Ring, away
from ndtorch_robot.sim.textures import ALONG

NEAR = 0.10
"""Metres from a true edge or surface within which mass of the map counts as right."""

FAINTEST = 0.02
"""A peak of the map counts when it is at least this share of its largest."""

REACH = 3
"""Cells around what the map holds that smoothing can reach, and one more."""

CAMERA_HEIGHT = 0.2
"""Height of the cameras, m; what does not reach there is not ranged."""

WINDOW = MatchParams()
"""Disparities that the rig of [A] ranges."""

CONTRAST = 0.08
"""Smallest jump of brightness that is an edge: ND-min answers it with 0.01, the weakest that is a feature."""


class MapScore(NamedTuple):
    """How good a map is; None where there is nothing to measure.

    Attributes:
        precision: share of the map's mass within 10 cm of a true edge.
        recall: share of the visible edges that have a peak of the map within 10 cm.
        position_error_cm: median distance from these edges to their peaks.
        spacing_error_percent: of the median distance between the peaks of neighbouring doors.
        surfaces: share of the map's mass within 10 cm of any surface. It asks less than precision, which asks for
            edges, and is the measure of a map of places that were ranged all along walls.
    """

    precision: float | None = None
    recall: float | None = None
    position_error_cm: float | None = None
    spacing_error_percent: float | None = None
    surfaces: float | None = None


class Edges(NamedTuple):
    """Vertical edges at the height of the cameras.

    Attributes:
        places: `[E, 2]`, m.
        faint: `[E]`, convex corners of two equally bright walls, which show only where one hides behind the other.
        normals: `[E, 2, 2]`, where the walls before and after the edge face.
    """

    places: Floats
    faint: npt.NDArray[np.bool_]
    normals: Floats


def true_edges(plan: Plan, profiles: list[Floats], height: float = CAMERA_HEIGHT) -> Edges:
    """Where brightness jumps by `CONTRAST` along a wall or between walls, and convex corners, up to `height`."""
    places: list[tuple[float, float]] = []
    faint: list[bool] = []
    normals: list[tuple[Floats, Floats]] = []
    first = 0
    for shape in plan.rings:
        corners = shape.array
        if not reaches(shape, plan, height):
            first += len(corners)
            continue
        along = np.roll(corners, -1, 0) - corners
        lengths = np.hypot(*along.T)
        along = along / lengths[:, None]
        facing = np.stack((-along[:, 1], along[:, 0]), -1)
        for k in range(len(corners)):
            mine, previous = profiles[first + k], profiles[first + (k - 1) % len(corners)]
            bend = float(along[k - 1, 0] * along[k, 1] - along[k - 1, 1] * along[k, 0])
            jump = abs(float(mine[:5].mean()) - float(previous[-5:].mean())) >= CONTRAST
            if jump or bend < -math.sin(math.radians(15)):
                places.append((float(corners[k, 0]), float(corners[k, 1])))
                faint.append(not jump)
                normals.append((facing[k - 1], facing[k]))
            for s in edge_columns(mine, CONTRAST):
                if 0.03 < s < lengths[k] - 0.03:  # nearer ones are the corner itself
                    x, y = corners[k] + s * along[k]
                    places.append((float(x), float(y)))
                    faint.append(False)
                    normals.append((facing[k], facing[k]))
        first += len(corners)
    count = len(places)
    return Edges(np.array(places).reshape(count, 2), np.array(faint, bool), np.array(normals).reshape(count, 2, 2))


def edge_columns(profile_: Floats, contrast: float, within: float = 0.02) -> Floats:
    """Where along a surface its brightness jumps, as metres from its start.

    A jump changes the brightness by `contrast` or more within `within` metres, and more than its surroundings.
    """
    step = max(1, round(within * ALONG / 2))
    if len(profile_) <= 2 * step + 1:
        return np.zeros(0)
    change = np.abs(profile_[2 * step :] - profile_[: -2 * step])
    found = []
    while len(change) and change.max() >= contrast:
        at = int(change.argmax())
        found.append((at + step + 0.5) / ALONG)
        change[max(0, at - 3 * step) : at + 3 * step + 1] = 0
    return np.sort(np.array(found))


def reaches(shape: Ring, plan: Plan, height: float) -> bool:
    return shape.bottom < height < (shape.height or plan.height)


def surfaces_of(plan: Plan, height: float = CAMERA_HEIGHT) -> Floats:
    """The surfaces at the height of the cameras, `[S, 2, 2]`: from, to; x, y."""
    sides = [shape.sides for shape in plan.rings if reaches(shape, plan, height)]
    return np.concatenate([np.zeros((0, 2, 2)), *sides])


def visible(
    plan: Plan, edges: Edges, poses: Floats, rig: StereoRig, times: int = 5, window: MatchParams = WINDOW
) -> npt.NDArray[np.bool_]:
    """Which edges could be ranged from at least `times` of the poses `[T, 3]`: inside both images, within the
    window of disparities, nothing in front, and not the faint corner of two walls that are both seen.
    """
    count = np.zeros(len(edges.places), dtype=np.int64)
    for x, y, heading in poses:
        offset = edges.places - (x, y)
        ahead = offset @ np.array([math.cos(heading), math.sin(heading)]) - rig.forward
        aside = offset @ np.array([-math.sin(heading), math.cos(heading)])
        depth = np.where(ahead > 0.1, ahead, np.inf)
        disparity = rig.focal * rig.baseline / depth
        outer = rig.focal * (np.abs(aside) + rig.baseline / 2) / depth
        camera = np.array([x + rig.forward * math.cos(heading), y + rig.forward * math.sin(heading)])
        seen = ((edges.normals * (camera - edges.places)[:, None]).sum(-1) > 0).all(1)
        good = (
            (disparity > window.min_disparity_px)
            & (disparity < window.max_disparity_px)
            & (outer < rig.width / 2 - 1)
            & ~(edges.faint & seen)
        )
        near = np.flatnonzero(good)
        if len(near):
            offset = edges.places[near] - camera
            reach = plan.cast(camera, np.arctan2(offset[:, 1], offset[:, 0]))
            count[near[reach >= np.hypot(*offset.T) - 0.02]] += 1
    return np.asarray(count >= times)


def peaks(cells: torch.Tensor, grid: Grid) -> Floats:
    """Places of the map's peaks `[P, 2]`: largest within 7 cm after smoothing over 5 cm."""
    used = cells.nonzero()
    if not len(used):
        return np.zeros((0, 2))
    # The rest of the map is empty, and most of it is the rest.
    low = (used.amin(0) - REACH).clamp(min=0).tolist()
    high = (used.amax(0) + REACH + 1).tolist()
    pooled = torch.nn.functional.avg_pool2d(cells[low[0] : high[0], low[1] : high[1]][None, None], 5, 1, 2)
    # The largest of each row and then of each column: a tenth of the time of the square.
    largest = torch.nn.functional.max_pool2d(pooled, (1, 15), 1, (0, 7))
    largest = torch.nn.functional.max_pool2d(largest, (15, 1), 1, (7, 0))
    row, column = torch.nonzero(((pooled == largest) & (pooled > FAINTEST * pooled.max()))[0, 0], as_tuple=True)
    return torch.stack(grid.center(row + low[0], column + low[1]), -1).double().numpy()


def score_map(
    cells: torch.Tensor,
    grid: Grid,
    plan: Plan,
    profiles: list[Floats],
    poses: Floats,
    rig: StereoRig,
    window: MatchParams = WINDOW,
) -> MapScore:
    """Compare a map with the truth."""
    edges = true_edges(plan, profiles, rig.camera_height)
    if float(cells.max()) <= 0:
        return MapScore()
    row, column = torch.nonzero(cells, as_tuple=True)
    mass = cells[row, column].double().numpy()
    places = torch.stack(grid.center(row, column), -1).double().numpy()
    precision = float(mass[nearest(places, edges.places) <= NEAR].sum() / mass.sum())
    surfaces = float(mass[away(places, surfaces_of(plan, rig.camera_height)) <= NEAR].sum() / mass.sum())
    seen = edges.places[visible(plan, edges, poses, rig, window=window)]
    tops = peaks(cells, grid)
    if not len(seen) or not len(tops):
        return MapScore(precision, surfaces=surfaces)
    error = nearest(seen, tops)
    found = error <= NEAR
    position = float(np.median(error[found])) * 100 if found.any() else None
    return MapScore(precision, float(found.mean()), position, spacing_error(plan, tops), surfaces)


def nearest(points: Floats, targets: Floats) -> Floats:
    """Distance of points `[N, 2]` to the nearest of targets `[M, 2]`."""
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(targets).query(points)[0]) if len(targets) else np.full(len(points), np.inf)


def spacing_error(plan: Plan, tops: Floats) -> float | None:
    """Error in percent of the median distance between peaks at the same corner of neighbouring doors."""
    found: list[float] = []
    for row in plan.doors:
        distance = np.hypot(*(np.array(row)[:, None] - tops).transpose(2, 0, 1))
        gaps = np.hypot(*np.diff(tops[distance.argmin(1)], axis=0).T)
        good = distance.min(1) <= NEAR
        found += gaps[good[1:] & good[:-1]].tolist()
    return abs(float(np.median(found)) / plan.spacing - 1) * 100 if found else None


def coverage(free: Floats, path: Floats, reach: float = 1.0) -> float:
    """Share of the free places `[N, 2]` that the car came within `reach` metres of."""
    return float((nearest(free, path[::10]) <= reach).mean())
