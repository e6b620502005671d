"""Loop closures: matching of overlapping submaps, and the decision which matches to accept.

Matches start within the uncertainty that the pose graph gives for the two submaps: along a bare wall a match could
slide anywhere. A single false loop closure between a room and its outside would displace the whole room. So closures
that would move many submaps by more than their uncertainty are held back until a closure of another submap agrees
(chi-square test on the innovation, with the covariance of the graph as in a Kalman filter).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.navigation.localisation.ndt import Scan, ScanMatch, from_sparse, match_scan
from ndtorch.navigation.localisation.params import LocaliserParams, SubmapParams
from ndtorch.navigation.localisation.pose_graph import (
    OUTLIER_GATE,
    Constraints,
    Floats,
    constraints,
    information_matrix,
    jacobians,
    joint_covariance,
    relative_pose,
    wrap_angle,
)
from ndtorch.navigation.localisation.submap import SIZE, Calibration, SubmapGraph, all_constraints, optimise_graph

SEARCH_SIGMAS = 3.0
"""A match begins this many standard deviations of the graph to all sides of the expected pose."""

MAX_SIGMA_M, MAX_SIGMA_RAD = 0.3, 0.1
"""Standard deviations with which a match begins, at most."""

ITERATIONS = 10
"""Gauss-Newton iterations of a match."""

CONSISTENCY_GATE = 16.0
"""Squared Mahalanobis distance from the expected pose up to which a match is consistent with the graph."""

DISTINCT_M, MIN_MARGIN = 0.1, 0.05
"""The score of the best match must exceed that of all matches farther away than this by the margin."""

INFORMATION_SCALE = 0.1
"""Factor of the information of a match, whose points are not independent."""

LARGE_CORRECTION_GATE, LARGE_CORRECTION_M = 9.0, 0.05
"""A submap is moved significantly beyond this squared Mahalanobis distance and this distance."""


def match_submaps(graph: SubmapGraph, params: LocaliserParams) -> SubmapGraph:
    """Match the next candidate pair; a good match becomes a loop closure."""
    row, graph = graph.candidates[0], graph._replace(candidates=graph.candidates[1:])
    first, second, covariance = int(row[0]), int(row[1]), row[2:].reshape(3, 3)
    start = relative_pose(graph.poses[first], graph.poses[second])
    # Points, not the means of cells: these are a cell apart along any wall and would lock into each other.
    scan = Scan(*np.ascontiguousarray(graph.submaps[second].points.T))
    ndt_map = from_sparse(graph.submaps[first].sparse, SIZE)
    place = min(MAX_SIGMA_M, SEARCH_SIGMAS * math.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[1]))
    turn = min(MAX_SIGMA_RAD, SEARCH_SIGMAS * math.sqrt(covariance[2, 2]))
    starts = [start + np.array((i * place, j * place, 0.0)) for i in (0, -1, 1) for j in (0, -1, 1)]
    matches = [match_scan(ndt_map, scan, at, (place, turn), params.cell_m, ITERATIONS) for at in starts]
    matches = [match for match in matches if is_consistent(match, start, covariance)]
    if not matches:
        return graph
    best = max(matches, key=lambda match: match.score)
    elsewhere = [one.score for one in matches if math.hypot(one.x - best.x, one.y - best.y) > DISTINCT_M]
    if best.score < params.submaps.min_score or best.score - max(elsewhere, default=0.0) < MIN_MARGIN:
        return graph
    edge = np.concatenate(((first, second), best.pose, best.information * INFORMATION_SCALE))
    return graph._replace(loop_closures=np.concatenate((graph.loop_closures, edge[None])))


def is_consistent(match: ScanMatch, expected: Floats, covariance: Floats) -> bool:
    """Whether a match lies within the uncertainty of the graph and its own."""
    off = match.pose - expected
    off[2] = wrap_angle(off[2])
    information = information_matrix(match.information) * INFORMATION_SCALE + 1e-3 * np.eye(3)
    return float(off @ np.linalg.solve(covariance + np.linalg.inv(information), off)) < CONSISTENCY_GATE


class Belief(NamedTuple):
    """Poses of the graph `[K, 3]` and their joint covariance `[3 K, 3 K]`."""

    poses: Floats
    covariance: Floats


class Innovation(NamedTuple):
    """A loop closure compared with the belief.

    Attributes:
        error: measured minus believed relative pose, `[3]`.
        covariance: of the error, `[3, 3]`.
        cross: covariance of all poses with the error, `[3 K, 3]`.
    """

    error: Floats
    covariance: Floats
    cross: Floats

    @property
    def distance(self) -> float:
        """Squared Mahalanobis distance."""
        return float(self.error @ np.linalg.solve(self.covariance, self.error))


def innovation(belief: Belief, closures: Constraints, n: int) -> Innovation:
    """The innovation of the n-th loop closure."""
    first, second = int(closures.first[n]), int(closures.second[n])
    error = closures.measure[n] - relative_pose(belief.poses[first], belief.poses[second])
    error[2] = wrap_angle(error[2])
    by_a, by_b = (slope[0] for slope in jacobians(belief.poses[first, None], belief.poses[second, None]))
    a, b = slice(3 * first, 3 * first + 3), slice(3 * second, 3 * second + 3)
    cross = belief.covariance[:, a] @ by_a.T + belief.covariance[:, b] @ by_b.T
    return Innovation(error, by_a @ cross[a] + by_b @ cross[b] + np.linalg.inv(closures.information[n]), cross)


def updated(belief: Belief, closures: Constraints, n: int) -> Belief:
    """The belief after a Kalman update with the n-th loop closure."""
    one = innovation(belief, closures, n)
    gain = np.linalg.solve(one.covariance, one.cross.T).T
    return Belief(belief.poses + (gain @ one.error).reshape(-1, 3), belief.covariance - gain @ one.cross.T)


def is_large_correction(belief: Belief, one: Innovation, newest: int, p: SubmapParams) -> bool:
    """Whether a loop closure would move many submaps before the newest by more than their uncertainty."""
    submap = np.arange(1, max(newest, 1))
    step = (one.cross @ np.linalg.solve(one.covariance, one.error)).reshape(-1, 3)[submap, :2]
    own = belief.covariance.reshape(len(belief.poses), 3, -1, 3)[submap, :2, submap, :2] + 1e-6 * np.eye(2)
    distance = np.einsum("ni,nij,nj->n", step, np.linalg.inv(own), step)
    moved = (distance > LARGE_CORRECTION_GATE) & (np.hypot(*step.T) > LARGE_CORRECTION_M)
    return int(moved.sum()) >= p.large_correction_count


def accept_and_optimise(graph: SubmapGraph, calibration: Calibration, params: SubmapParams) -> SubmapGraph:
    """Accept or hold back the loop closures of the newest submap, then optimise the graph."""
    return optimise_graph(accept_closures(graph, calibration, params), calibration)


def accept_closures(graph: SubmapGraph, calibration: Calibration, p: SubmapParams) -> SubmapGraph:
    """The graph with the closures of the newest submap, and those held back so far, accepted or held back."""
    newest = len(graph.submaps) - 1
    new = graph.loop_closures[:, 1] == newest
    tried = np.concatenate((graph.unconfirmed, graph.loop_closures[new]))
    if not len(tried):
        return graph
    graph = graph._replace(loop_closures=graph.loop_closures[~new])
    c, closures = all_constraints(graph, calibration.mean), constraints(tried)
    belief = Belief(graph.poses, joint_covariance(graph.poses, c, OUTLIER_GATE, calibration.sigma))
    left, accepted = list(range(len(tried))), list[int]()
    while left:
        innovations = {n: innovation(belief, closures, n) for n in left}
        # The smallest first: its update may make the others smaller.
        left.sort(key=lambda n: innovations[n].distance)
        good = next(([n] for n in left if not is_large_correction(belief, innovations[n], newest, p)), None)
        good = confirmed(belief, closures, left, newest, p) if good is None else good
        for n in good:
            belief = updated(belief, closures, n)
            left.remove(n)
        if not good:
            break
        accepted += good
    left = [n for n in left if newest - int(closures.second[n]) < p.confirmation_max_submaps]
    closed = np.concatenate((graph.loop_closures, tried[accepted]))
    return graph._replace(loop_closures=closed, unconfirmed=tried[left])


def confirmed(belief: Belief, closures: Constraints, left: list[int], newest: int, p: SubmapParams) -> list[int]:
    """A closure of the newest submap and one of another submap that agrees with it; empty if there are none."""
    for n in (n for n in left if closures.second[n] == newest):
        with_it = updated(belief, closures, n)
        for m in (m for m in left if closures.second[m] != newest):
            one = innovation(with_it, closures, m)
            if one.distance < p.confirmation_gate and not is_large_correction(with_it, one, newest, p):
                return [n, m]
    return []
