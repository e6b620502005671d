"""Normal distributions transform: a map of Gaussian cells, and matching of a scan with it.

P. Biber and W. Straßer, "The normal distributions transform: a new approach to laser scan matching", IROS 2003. A cell
holds the weight of its points and the sums of x, y, xx, xy and yy about its middle, from which mean and covariance
follow. A map is an array of cells `[size, size, 6]`, float32, whose middle is the origin of its frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ndtorch.navigation.localisation._kernels import Cells, Floats, add_points, ndt_match


class Scan(NamedTuple):
    """Points in the body frame, m, and their weights, `[n]` each."""

    x: Floats
    y: Floats
    weight: Floats


class ScanMatch(NamedTuple):
    """A matched pose x, y, m, and heading, radians, `[3]`, its score, 0..1, and its information matrix `[3, 3]` as if
    all points were independent."""

    pose: Floats
    score: float
    information: Floats


def empty_map(size: int) -> Cells:
    """A map without points."""
    return np.zeros((size, size, 6), np.float32)


def add_scan(ndt_map: Cells, scan: Scan, pose: Floats, cell_m: float) -> Cells:
    """A copy of the map to which a scan taken at a pose is added."""
    x, y, heading = pose.tolist()
    cos, sin = np.cos(heading), np.sin(heading)
    ndt_map = ndt_map.copy()
    add_points(ndt_map, x + cos * scan.x - sin * scan.y, y + sin * scan.x + cos * scan.y, scan.weight, cell_m)
    return ndt_map


def match_scan(ndt_map: Cells, scan: Scan, start: Floats, sigma: tuple[float, float], cell_m: float) -> ScanMatch:
    """The pose at which a scan fits the map.

    Args:
        start: predicted pose, `[3]`.
        sigma: standard deviations of its position, m, and of its heading, radians.
    """
    precision = np.array((sigma[0], sigma[0], sigma[1])) ** -2.0
    return ScanMatch(*ndt_match(ndt_map, *scan, start, precision, cell_m))


def to_sparse(ndt_map: Cells) -> Cells:
    """The cells that hold points, `[k, 8]`: column and row counted from the middle, and six sums."""
    at = np.argwhere(ndt_map[..., 0])
    return np.concatenate(((at - ndt_map.shape[0] // 2).astype(np.float32), ndt_map[at[:, 0], at[:, 1]]), -1)


def from_sparse(sparse: npt.NDArray[np.floating], size: int) -> Cells:
    """The inverse of `to_sparse`; cells outside the square are dropped."""
    ndt_map, half = empty_map(size), size // 2
    at = np.rint(sparse[:, :2]).astype(np.int64)
    inside = ((at >= -half) & (at < half)).all(-1)
    column, row = (at[inside] + half).T
    ndt_map[column, row] = sparse[inside, 2:]
    return ndt_map
