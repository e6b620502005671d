"""Submaps: pieces of the map, a few driven metres each, that keep their shape and move as wholes.

A submap is an NDT map in a frame of its own. Consecutive submaps are tied by odometry, overlapping ones by loop
closures. When a submap is finished and matched, the pose graph is optimised and the map is rendered anew.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.navigation.localisation._kernels import MIN_WEIGHT, Cells, add_cells, add_points
from ndtorch.navigation.localisation.ndt import Scan, empty_map, to_sparse, transformed
from ndtorch.navigation.localisation.odometry_edge import OdometryEdge, compose, empty_edge, odometry_constraints
from ndtorch.navigation.localisation.params import LocaliserParams, SubmapParams
from ndtorch.navigation.localisation.pose_graph import (
    EDGE,
    OUTLIER_GATE,
    Constraints,
    Floats,
    compose_poses,
    constraints,
    gauss_newton_step,
    marginal_covariances,
    relative_pose,
)

SIZE = 72
"""Cells along each side of a submap."""

MIN_SHARED_CELLS = 5
"""Cells that a submap needs, and that two submaps need in common to be matched."""

OVERLAP_CELL_M = 0.5
"""Side of the squares by which the overlap of two submaps is measured."""

REDUNDANT_GAP_M = 8.0
"""No submap is dropped this far after the last one that was kept: one wrong loop closure could turn the next one."""

MAX_CANDIDATES = 10
"""Submaps that a new one is matched with, at most."""

MAX_POINTS = 100
"""Points of a submap that are matched with others, at most."""

MAX_MERGED = 256
"""Frames of dropped submaps that are kept: what stands in them follows to the frame that lasts."""

GRAPH_ITERATIONS = 2
"""Gauss-Newton iterations of the pose graph after each submap."""


class Submap(NamedTuple):
    """A finished submap.

    Attributes:
        sparse: its cells, `[k, 8]`, see `ndt.to_sparse`.
        means: of the cells, `[k, 2]`, m.
        points: a selection of its points and their weights, `[m, 3]`.
        odometry: from the origin of the submap before it to its own.
    """

    sparse: Floats
    means: Floats
    points: Floats
    odometry: OdometryEdge


class SubmapGraph(NamedTuple):
    """State of the pose graph.

    Attributes:
        submaps: the K finished ones.
        poses: of their frames and of that of the submap being made, `[K + 1, 3]`.
        begun: steps at which they began, `[K + 1]`, without merged ones.
        cells: of the submap being made, `[SIZE, SIZE, 6]`.
        points: of the submap being made, `[m, 3]`.
        odometry: from the origin of the last finished submap to that of the one being made.
        driven: odometry since then.
        loop_closures: edges between submaps, `[E, 11]`, see `pose_graph.EDGE`.
        candidates: pairs still to be matched, and the covariance of the second in the frame of the first, `[n, 11]`.
        merged_submaps: frames of the last dropped submaps, which move with the finished one that overlaps them most,
            `[n, 5]`: step at which it began, index of that submap, pose in its frame.
        scans: the same for single scans, numbered half a step late, while the log may still be replayed.
        learning_s: submaps begun before this time are used only where no other shows anything.
        unconfirmed: loop closures that would move many submaps and wait for another one, `[n, 11]`.
    """

    submaps: tuple[Submap, ...]
    poses: Floats
    begun: Floats
    cells: Cells
    points: Floats
    odometry: OdometryEdge
    driven: OdometryEdge
    loop_closures: Floats
    candidates: Floats
    merged_submaps: Floats
    scans: Floats
    learning_s: float
    unconfirmed: Floats


class Calibration(NamedTuple):
    """Scale, bend and drift of odometry and their standard deviations, `[3]` each."""

    mean: Floats
    sigma: Floats


def empty_graph(pose: Floats, params: LocaliserParams) -> SubmapGraph:
    """A graph whose first submap begins at a pose."""
    none, frames = np.zeros((0, EDGE)), np.zeros((0, 5))
    return SubmapGraph(
        submaps=(),
        poses=pose[None],
        begun=np.zeros(1),
        cells=empty_map(SIZE),
        points=np.zeros((0, 3)),
        odometry=empty_edge(),
        driven=empty_edge(),
        loop_closures=none,
        candidates=none,
        merged_submaps=frames,
        scans=frames,
        learning_s=params.submaps.learning_s,
        unconfirmed=none,
    )


def merge_into(graph: SubmapGraph, index: int) -> SubmapGraph:
    """Keep the frame of the submap being made, which is dropped, as one that moves with a finished submap."""
    at = relative_pose(graph.poses[index], graph.poses[-1])
    row = np.array([[graph.begun[-1], index, *at]])
    scans = graph.scans.copy()
    here = scans[:, 1] == len(graph.submaps)
    scans[here, 2:] = compose_poses(at, scans[here, 2:])
    scans[here, 1] = index
    merged = np.concatenate((graph.merged_submaps[1 - MAX_MERGED :], row))
    return graph._replace(merged_submaps=merged, scans=scans)


def add_scan_frame(graph: SubmapGraph, pose: Floats, age: int) -> SubmapGraph:
    """The graph with a frame for a scan taken at a pose of the world."""
    at = relative_pose(graph.poses[-1], pose)
    row = np.array([[age + 0.5, len(graph.submaps), *at]])
    return graph._replace(scans=np.concatenate((graph.scans, row)))


def add_to_submap(graph: SubmapGraph, scan: Scan, pose: Floats, cell_m: float) -> SubmapGraph:
    """The graph with a scan, taken at a pose of the world, in the submap being made."""
    x, y = transformed(scan, relative_pose(graph.poses[-1], pose))
    cells = graph.cells.copy()
    add_points(cells, x, y, scan.weight, cell_m)
    return graph._replace(cells=cells, points=np.concatenate((graph.points, np.stack((x, y, scan.weight), -1))))


def restart_at(graph: SubmapGraph, pose: Floats, age: int) -> SubmapGraph:
    """Begin the present submap anew at a pose to which the car was carried."""
    odometry = empty_edge()
    if graph.submaps:
        odometry = odometry._replace(pose=relative_pose(graph.poses[-2], pose))
        graph = merge_into(graph, len(graph.submaps) - 1)
    else:
        graph = graph._replace(scans=graph.scans[:0])
    return graph._replace(
        poses=np.concatenate((graph.poses[:-1], pose[None])),
        begun=np.append(graph.begun[:-1], age),
        cells=np.zeros_like(graph.cells),
        points=graph.points[:0],
        odometry=odometry,
        driven=empty_edge(),
    )


def is_complete(graph: SubmapGraph, p: SubmapParams) -> bool:
    """Whether the submap being made has its length and enough cells, or its maximum length."""
    length = graph.driven.length
    if length <= p.length_m:
        return False
    return length > p.max_length_m or int((graph.cells[..., 0] >= MIN_WEIGHT).sum()) >= p.min_cells


def finish_submap(
    graph: SubmapGraph, pose: Floats, age: int, dt: float, calibration: Calibration, params: LocaliserParams
) -> SubmapGraph:
    """End the present submap at a pose, where the next one begins, and list the submaps to match it with.

    A submap that shows nothing new is merged into another one.
    """
    p = params.submaps
    cells = to_sparse(graph.cells)
    sparse = cells[cells[:, 2] >= MIN_WEIGHT].astype(np.float64)
    means = (sparse[:, :2] + 0.5) * params.cell_m + sparse[:, 3:5] / sparse[:, 2:3]
    overlap, known = overlaps(graph, means, graph.begun[:-1] * dt < graph.learning_s, p.redundant_views)
    empty = graph._replace(cells=np.zeros_like(graph.cells), points=graph.points[:0], driven=empty_edge())
    since = graph.odometry.length + graph.driven.length
    redundant = known > p.redundant_ratio and since < REDUNDANT_GAP_M
    full = len(graph.submaps) >= p.max_submaps
    if graph.submaps and (len(means) < MIN_SHARED_CELLS or redundant or full):
        return merge_into(empty, int(overlap.argmax()))._replace(
            poses=np.concatenate((graph.poses[:-1], pose[None])),
            begun=np.append(graph.begun[:-1], age),
            odometry=compose(graph.odometry, graph.driven),
        )
    selected = np.rint(np.linspace(0, len(graph.points) - 1, min(MAX_POINTS, len(graph.points)))).astype(np.int64)
    return empty._replace(
        submaps=(*graph.submaps, Submap(sparse, means, graph.points[selected], graph.odometry)),
        poses=np.concatenate((graph.poses, pose[None])),
        begun=np.append(graph.begun, age),
        odometry=graph.driven,
        candidates=np.concatenate((graph.candidates, match_candidates(graph, overlap, len(means), calibration))),
    )


def match_candidates(
    graph: SubmapGraph, overlap: npt.NDArray[np.int64], cells: int, calibration: Calibration
) -> Floats:
    """Rows of `SubmapGraph.candidates` for the submap being made, `[n, 11]`.

    Args:
        overlap: with each finished submap, `[K]`.
        cells: of the submap being made.
    """
    new = len(graph.submaps)
    # Relative to the smaller submap: by number, the few cells of an early one in a bare corridor would never be chosen.
    size = np.array([len(submap.means) for submap in graph.submaps], float).clip(1, max(1, cells))
    order = np.argsort(-overlap / size, kind="stable")
    chosen = np.array([n for n in order if overlap[n] >= MIN_SHARED_CELLS][:MAX_CANDIDATES], np.int64)
    if not len(chosen):
        return np.zeros((0, EDGE))
    c = all_constraints(graph, calibration.mean)
    covariance = marginal_covariances(graph.poses, c, OUTLIER_GATE, calibration.sigma, new, chosen)
    return np.column_stack((chosen, np.full(len(chosen), new), covariance.reshape(-1, 9)))


def overlaps(
    graph: SubmapGraph, means: Floats, early: npt.NDArray[np.bool_], views: int
) -> tuple[npt.NDArray[np.int64], float]:
    """How many cells of the submap being made each finished one shares, `[K]`, and the share that several show.

    Args:
        means: of its cells, `[k, 2]`.
        early: finished submaps that do not count as views, `[K]`.
        views: submaps that must show a cell for it to be known.
    """
    poses, count = graph.poses, len(graph.submaps)
    if not count or not len(means):
        return np.zeros(count, np.int64), 0.0
    mine = square_keys(in_world(poses[-1], means))
    owner = np.repeat(np.arange(count), [len(submap.means) for submap in graph.submaps])
    theirs = square_keys(in_world(poses[owner], np.concatenate([submap.means for submap in graph.submaps])))
    squares, at = np.unique(mine, return_inverse=True)
    where = np.searchsorted(squares, theirs)
    where[where == len(squares)] = 0
    hit = squares[where] == theirs
    seen = np.zeros((count, len(squares)), bool)
    seen[owner[hit], where[hit]] = True
    weight = np.bincount(at, minlength=len(squares))
    known = seen[~early].sum(0) >= views
    return seen @ weight, float(weight[known].sum() / len(mine))


def in_world(pose: Floats, points: Floats) -> Floats:
    """Points `[n, 2]` of frames, in the world."""
    return compose_poses(pose, np.concatenate((points, np.zeros((len(points), 1))), -1))[:, :2]


def square_keys(points: Floats) -> npt.NDArray[np.int64]:
    """A key for the square in which each point lies."""
    at = np.floor(points / OVERLAP_CELL_M).astype(np.int64)
    return at[:, 0] * (1 << 32) + at[:, 1]


def all_constraints(graph: SubmapGraph, calibration: Floats) -> Constraints:
    """Loop closures and odometry, the latter corrected by scale, bend and drift `[3]`."""
    rows, jacobian = odometry_constraints([*(submap.odometry for submap in graph.submaps[1:]), graph.odometry])
    edges = np.concatenate((graph.loop_closures, rows))
    common = np.concatenate((np.zeros((len(graph.loop_closures), 3, 3)), jacobian))
    edges[:, 2:5] += common @ calibration
    return constraints(edges, common)


def optimise_graph(graph: SubmapGraph, calibration: Calibration) -> SubmapGraph:
    """The graph with its submaps moved to where loop closures and odometry agree best."""
    c, poses, more = all_constraints(graph, calibration.mean), graph.poses, np.zeros(3)
    for _ in range(GRAPH_ITERATIONS):
        poses, more = gauss_newton_step(poses, c, OUTLIER_GATE, more, calibration.sigma)
    return graph._replace(poses=poses)


def render_map(graph: SubmapGraph, dt: float, params: LocaliserParams) -> Cells:
    """The NDT map of all submaps at their present poses; early submaps fill only what no other shows."""
    ndt_map, early_map = empty_map(params.map_cells), empty_map(params.map_cells)
    cells = [*(submap.sparse for submap in graph.submaps), to_sparse(graph.cells).astype(np.float64)]
    early = (graph.begun * dt < graph.learning_s).tolist()
    for pose, sparse, first in zip(graph.poses.tolist(), cells, early, strict=True):
        add_cells(early_map if first else ndt_map, sparse, tuple(pose), params.cell_m)
    if any(early):
        return np.where(ndt_map[..., :1] < MIN_WEIGHT, ndt_map + early_map, ndt_map)
    return ndt_map
