"""Relocalisation: the pose in a known map from an unknown start, by correlative scan matching over all poses.

What the car has mapped around itself is matched with a likelihood field of the known map, one heading a step. The best
poses are refined by NDT scan matching, and the best of them is accepted if no other place fits nearly as well.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ndtorch.navigation.localisation._kernels import Cells, score_positions
from ndtorch.navigation.localisation.ndt import Scan, distributions, match_scan
from ndtorch.navigation.localisation.params import RelocalisationParams
from ndtorch.navigation.localisation.pose_graph import Floats

PIXEL_M, BLUR_M = 0.1, 0.12
"""Side of a pixel of the likelihood field, and its standard deviation around walls."""

LINE_SIGMA_M = 0.03
"""Standard deviation along a cell's distribution that is drawn, at least."""

STRIDE_PX = 2
"""Positions are tried this many pixels apart."""

CANDIDATES_PER_ROTATION = 2
"""Best positions of a heading that become candidates."""

REFINE_SIGMA = 0.3
"""Standard deviation of a candidate, m and radians, with which its refinement begins."""

REFINE_ITERATIONS = 15
"""Gauss-Newton iterations of a refinement."""

DISTINCT_M, DISTINCT_RAD = 0.5, math.radians(15.0)
"""Poses farther apart than this are different places."""


class LikelihoodField(NamedTuple):
    """The known map as an image.

    Attributes:
        values: `[rows, columns]`, 1 on a wall and less around it.
        left, bottom: of the middle of the first pixel, m.
    """

    values: Cells
    left: float
    bottom: float


class Relocalisation(NamedTuple):
    """State of a search.

    Attributes:
        pattern: means of the cells around the car in its frame at the beginning, `[n, 2]`, m.
        origin: that pose in the frame in which the car drives, `[3]`.
        rotation: index of the next heading; -1 before a search, after the last one candidates are refined.
        candidates: score, x, y and heading in the known map, best first, `[k, 4]`.
        refined: the same of refined candidates, `[m, 4]`.
        distance: driven since the last search began, m.
    """

    pattern: Floats
    origin: Floats
    rotation: int
    candidates: Floats
    refined: Floats
    distance: float


def likelihood_field(ndt_map: Cells, cell_m: float) -> LikelihoodField:
    """The likelihood field of a map: a line along each distribution, blurred."""
    mean, covariance = distributions(ndt_map, cell_m)
    value, axes = np.linalg.eigh(covariance)
    along = np.sqrt(np.maximum(value[:, 1], LINE_SIGMA_M**2))[:, None] * axes[:, :, 1]
    points = (mean[:, None] + np.linspace(-1.5, 1.5, 5)[:, None] * along[:, None]).reshape(-1, 2)
    border = 4 * BLUR_M
    left, bottom = points.min(0) - border if len(points) else (0.0, 0.0)
    right, top = points.max(0) + border if len(points) else (0.0, 0.0)
    columns, rows = math.ceil((right - left) / PIXEL_M) + 1, math.ceil((top - bottom) / PIXEL_M) + 1
    values, reach = np.zeros((rows, columns), np.float32), math.ceil(2.5 * BLUR_M / PIXEL_M)
    place = (points - (left, bottom)) / PIXEL_M
    near = np.rint(place).astype(np.int64)
    for down in range(-reach, reach + 1):
        for across in range(-reach, reach + 1):
            column, row = near[:, 0] + across, near[:, 1] + down
            square = ((column - place[:, 0]) ** 2 + (row - place[:, 1]) ** 2) * PIXEL_M**2
            inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
            likelihood = np.exp(-square / (2 * BLUR_M**2)).astype(np.float32)
            np.maximum.at(values, (row[inside], column[inside]), likelihood[inside])
    return LikelihoodField(values, float(left), float(bottom))


def no_search() -> Relocalisation:
    """Before the first search."""
    return Relocalisation(np.zeros((0, 2)), np.zeros(3), -1, np.zeros((0, 4)), np.zeros((0, 4)), 0.0)


def start_search(
    search: Relocalisation, ndt_map: Cells, pose: Floats, cell_m: float, p: RelocalisationParams
) -> Relocalisation:
    """Begin a search with the cells around the car, if there are enough of them."""
    offset = distributions(ndt_map, cell_m)[0] - pose[:2]
    offset = offset[np.hypot(*offset.T) < p.radius_m]
    if len(offset) < p.min_cells:
        return search._replace(distance=search.distance - p.retry_m)
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    pattern = np.stack((cos * offset[:, 0] + sin * offset[:, 1], cos * offset[:, 1] - sin * offset[:, 0]), -1)
    return no_search()._replace(pattern=pattern, origin=pose, rotation=0)


def score_rotation(search: Relocalisation, field: LikelihoodField, p: RelocalisationParams) -> Relocalisation:
    """Match the pattern at the next heading with the field at all positions; the best become candidates."""
    heading = 2 * math.pi * search.rotation / p.rotations
    cos, sin = math.cos(heading), math.sin(heading)
    px, py = search.pattern.T
    x, y = (cos * px - sin * py) / PIXEL_M, (sin * px + cos * py) / PIXEL_M
    rows, columns = field.values.shape
    scores = np.zeros((-(-rows // STRIDE_PX), -(-columns // STRIDE_PX)), np.float32)
    score_positions(field.values, x, y, STRIDE_PX, scores)
    found = []
    for _ in range(CANDIDATES_PER_ROTATION):
        i, j = np.unravel_index(int(scores.argmax()), scores.shape)
        place = (field.left + j * STRIDE_PX * PIXEL_M, field.bottom + i * STRIDE_PX * PIXEL_M)
        found.append((float(scores[i, j]), *place, heading))
        scores[max(0, i - 2) : i + 3, max(0, j - 2) : j + 3] = 0.0
    candidates = np.concatenate((search.candidates, found))
    best = np.argsort(-candidates[:, 0], kind="stable")[: p.max_candidates]
    return search._replace(candidates=candidates[best], rotation=search.rotation + 1)


def refine(search: Relocalisation, known: Cells, cell_m: float) -> Relocalisation:
    """Refine the best candidate that is left by scan matching."""
    x, y = np.ascontiguousarray(search.pattern.T)
    scan, sigma = Scan(x, y, np.ones(len(x))), (REFINE_SIGMA, REFINE_SIGMA)
    match = match_scan(known, scan, search.candidates[0, 1:], sigma, cell_m, REFINE_ITERATIONS)
    refined = np.concatenate((search.refined, [[match.score, *match.pose]]))
    return search._replace(candidates=search.candidates[1:], refined=refined)


def best_pose(search: Relocalisation, p: RelocalisationParams) -> Floats | None:
    """The pose `[3]` at which the pattern was seen; None if none is good, or another place is nearly as good."""
    refined = search.refined
    best: Floats = refined[refined[:, 0].argmax()]
    far = np.hypot(*(refined[:, 1:3] - best[1:3]).T) > DISTINCT_M
    turned = np.abs(np.angle(np.exp(1j * (refined[:, 3] - best[3])))) > DISTINCT_RAD
    others = refined[far | turned, 0]
    if best[0] < p.min_score or best[0] - others.max(initial=0.0) < p.min_margin:
        return None
    return best[1:]


def pose_now(search: Relocalisation, found: Floats, pose: Floats) -> Floats:
    """The present pose in the known map, of a car that has driven on to `pose` since the search began."""
    turn = found[2] - search.origin[2]
    cos, sin = math.cos(turn), math.sin(turn)
    dx, dy = pose[:2] - search.origin[:2]
    return np.array((found[0] + cos * dx - sin * dy, found[1] + sin * dx + cos * dy, pose[2] + turn))
