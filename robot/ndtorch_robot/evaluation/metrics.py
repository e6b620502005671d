"""Metrics of a drive against the true plan and the true path."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from scipy.signal import find_peaks
from scipy.spatial import cKDTree

from ndtorch.navigation import Grid, StereoRig
from ndtorch.navigation.stereo.features import MatchParams
from ndtorch_robot.sim.plan import Floats, Plan, away
from ndtorch_robot.sim.textures import ALONG

NEAR, FAINTEST = 0.10, 0.02
"""Metres from a true edge within which mass of the map counts as right, and part of the largest peak that is one."""

CONTRAST, WITHIN = 0.08, 0.02
"""Smallest jump of brightness that is an edge (ND-min answers it with 0.01, the weakest that is a feature), and the
length of wall in which it jumps, m."""

OFTEN = 5
"""Poses from which an edge must be visible."""


class MapScore(NamedTuple):
    """How good a map is; None where there is nothing to measure."""

    precision: float | None = None  # part of the map's mass within 10 cm of a true edge
    recall: float | None = None  # part of the visible edges that have a peak of the map within 10 cm
    position_error_cm: float | None = None  # median distance from these edges to their peaks
    spacing_error_percent: float | None = None  # of the median distance of the peaks of neighbouring doors
    surfaces: float | None = None  # part of the mass within 10 cm of any surface, for maps ranged along walls


class Edges(NamedTuple):
    """Vertical edges at the height of the cameras: places, m, and where the walls before and after them face.

    Faint ones are convex corners of two equally bright walls, which show only where one hides behind the other.
    """

    places: Floats  # [E, 2]
    faint: npt.NDArray[np.bool_]  # [E]
    normals: Floats  # [E, 2, 2]


def true_edges(plan: Plan, profiles: list[Floats], height: float) -> Edges:
    """Where brightness jumps by `CONTRAST` along a wall or between walls, and convex corners, at a height, m."""
    rows: list[tuple[Floats, bool, Floats, Floats]] = []
    first = 0
    for shape in plan.rings:
        count, sides = len(shape.points), shape.sides
        own, first = profiles[first : first + count], first + count
        if not shape.bottom < height < (shape.height or plan.height):
            continue
        along = sides[:, 1] - sides[:, 0]
        lengths = np.hypot(*along.T)
        along = along / lengths[:, None]
        facing = np.stack((-along[:, 1], along[:, 0]), -1)
        for k in range(count):
            bend = float(along[k - 1, 0] * along[k, 1] - along[k - 1, 1] * along[k, 0])
            jump = abs(float(own[k][:5].mean()) - float(own[k - 1][-5:].mean())) >= CONTRAST
            if jump or bend < -math.sin(math.radians(15)):
                rows.append((sides[k, 0], not jump, facing[k - 1], facing[k]))
            for s in edge_columns(own[k]):
                if 0.03 < s < lengths[k] - 0.03:  # nearer ones are the corner itself
                    rows.append((sides[k, 0] + s * along[k], False, facing[k], facing[k]))
    places, faint, before, after = zip(*rows, strict=True) if rows else ((), (), (), ())
    normals = np.stack((np.array(before).reshape(-1, 2), np.array(after).reshape(-1, 2)), 1)
    return Edges(np.array(places).reshape(-1, 2), np.array(faint, bool), normals)


def edge_columns(profile: Floats) -> Floats:
    """Where along a surface its brightness jumps more than in its surroundings, as metres from its start."""
    step = round(WITHIN * ALONG / 2)
    change = np.abs(profile[2 * step :] - profile[: -2 * step])
    jumps, _ = find_peaks(np.pad(change, 1), height=CONTRAST, distance=3 * step + 1)
    return np.asarray((jumps - 1 + step + 0.5) / ALONG)


def visible(
    plan: Plan, edges: Edges, poses: Floats, rig: StereoRig, window: MatchParams | None = None
) -> npt.NDArray[np.bool_]:
    """Which edges could be ranged from at least `OFTEN` of the poses `[T, 3]`: inside both images, within the window of
    disparities, nothing in front, and not the faint corner of two walls that both face the camera.
    """
    count, window = np.zeros(len(edges.places), dtype=np.int64), window or MatchParams()
    for x, y, heading in poses:
        forward = np.array([math.cos(heading), math.sin(heading)])
        camera = np.array([x, y]) + rig.forward * forward
        offset = edges.places - camera
        ahead, aside = offset @ forward, offset @ np.array([-forward[1], forward[0]])
        depth = np.where(ahead > 0.1, ahead, np.inf)
        disparity = rig.focal * rig.baseline / depth
        outer = rig.focal * (np.abs(aside) + rig.baseline / 2) / depth
        both = (-(edges.normals * offset[:, None]).sum(-1) > 0).all(1)
        inside = (outer < rig.width / 2 - 1) & (disparity > window.min_disparity_px)
        near = np.flatnonzero(inside & (disparity < window.max_disparity_px) & ~(edges.faint & both))
        reach = plan.cast(camera, np.arctan2(offset[near, 1], offset[near, 0]))
        count[near[reach >= np.hypot(*offset[near].T) - 0.02]] += 1
    return np.asarray(count >= OFTEN)


def peaks(cells: torch.Tensor, grid: Grid) -> Floats:
    """Places of the map's peaks `[P, 2]`: largest within 7 cm after smoothing over 5 cm."""
    pooled = torch.nn.functional.avg_pool2d(cells[None, None], 5, 1, 2)
    # The largest of each row and then of each column: a tenth of the time of the square.
    largest = torch.nn.functional.max_pool2d(pooled, (1, 15), 1, (0, 7))
    largest = torch.nn.functional.max_pool2d(largest, (15, 1), 1, (7, 0))
    row, column = torch.nonzero(((pooled == largest) & (pooled > FAINTEST * pooled.max()))[0, 0], as_tuple=True)
    return torch.stack(grid.center(row, column), -1).double().numpy()


def score_map(
    cells: torch.Tensor,
    grid: Grid,
    plan: Plan,
    profiles: list[Floats],
    poses: Floats,
    rig: StereoRig,
    window: MatchParams | None = None,
) -> MapScore:
    edges = true_edges(plan, profiles, rig.camera_height)
    if float(cells.max()) <= 0:
        return MapScore()
    row, column = torch.nonzero(cells, as_tuple=True)
    mass = cells[row, column].double().numpy()
    places = torch.stack(grid.center(row, column), -1).double().numpy()
    heights = [shape for shape in plan.rings if shape.bottom < rig.camera_height < (shape.height or plan.height)]
    distances = nearest(places, edges.places), away(places, np.concatenate([shape.sides for shape in heights]))
    precision, surfaces = (float(mass[distance <= NEAR].sum() / mass.sum()) for distance in distances)
    wanted, tops = edges.places[visible(plan, edges, poses, rig, window)], peaks(cells, grid)
    if not len(wanted) or not len(tops):
        return MapScore(precision, surfaces=surfaces)
    error = nearest(wanted, tops)
    hit = error <= NEAR
    position = float(np.median(error[hit])) * 100 if hit.any() else None
    gaps: list[float] = []  # between peaks at the same corner of neighbouring doors
    for corners in plan.doors:
        distance = np.hypot(*(np.array(corners)[:, None] - tops).transpose(2, 0, 1))
        good = distance.min(1) <= NEAR
        gaps += np.hypot(*np.diff(tops[distance.argmin(1)], axis=0).T)[good[1:] & good[:-1]].tolist()
    spacing = abs(float(np.median(gaps)) / math.dist(*plan.doors[0][:2]) - 1) * 100 if gaps else None
    return MapScore(precision, float(hit.mean()), position, spacing, surfaces)


def nearest(points: Floats, targets: Floats) -> Floats:
    """Distance of points `[N, 2]` to the nearest of targets `[M, 2]`."""
    return np.asarray(cKDTree(targets).query(points)[0]) if len(targets) else np.full(len(points), np.inf)
