"""What was ranged, gathered in cells of normal distributions: the map that a car finds its place in.

The normal distributions transform of P. Biber and W. Straßer, "The normal distributions transform: a new approach to
laser scan matching", IROS 2003. A cell knows the weight of its points, their middle and their covariance. In a cell on
a wall the distribution is a thin line, at an edge it is a spot.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from ndtorch.kernels.add_points import add_points
from ndtorch.kernels.fit_points import fit_points
from ndtorch.navigation.localisation.params import LocaliserParams

Floats = npt.NDArray[Any]


class Scan(NamedTuple):
    """Points of the body frame, m, and their weights, all `[n]`, float64."""

    x: Floats
    y: Floats
    weight: Floats


class Fit(NamedTuple):
    """A pose, m and radians, how well a scan fits there, 0..1, and what it says of the pose.

    `information` `[6]` is one over the variances of the pose, xx, xy, yy, xh, yh, hh, had every point been independent.
    """

    x: float
    y: float
    heading: float
    score: float
    information: Floats


def empty_walls(params: LocaliserParams) -> Tensor:
    """Cells without anything in them, `[size, size, 6]`."""
    return torch.zeros(params.size, params.size, 6)


def add_scan(walls: Tensor, scan: Scan, pose: tuple[float, float, float], params: LocaliserParams) -> Tensor:
    """New cells, with a scan seen from a pose added."""
    walls = walls.clone()
    x, y, heading = pose
    cos, sin = np.cos(heading), np.sin(heading)
    add_points(
        walls.numpy(),
        x + cos * scan.x - sin * scan.y,
        y + sin * scan.x + cos * scan.y,
        scan.weight,
        params.cell,
        params.most,
    )
    return walls


def fit_scan(
    walls: Tensor,
    scan: Scan,
    start: tuple[float, float, float],
    deviations: tuple[float, float],
    params: LocaliserParams,
    steps: int | None = None,
) -> Fit:
    """The pose from which a scan fits the walls.

    Args:
        start: the pose expected.
        deviations: standard deviations of its place, m, and of its heading, radians.
        steps: of Gauss-Newton, at most; those of the parameters by default.
    """
    p, out = params, np.zeros(10)
    place, heading = (1 / deviation**2 for deviation in deviations)
    fit_points(
        walls.numpy(),
        *scan,
        start,
        (place, place, heading),
        p.cell,
        p.blur,
        p.least,
        p.gate,
        steps or p.steps,
        out,
    )
    x, y, heading, score = out[:4].tolist()
    return Fit(x, y, heading, score, out[4:])


def pack(walls: Tensor) -> Tensor:
    """The cells that have anything in them, for a file: column and row from the middle, and six sums, `[k, 8]`."""
    at = walls[..., 0].nonzero()
    return torch.cat(((at - walls.shape[0] // 2).to(walls.dtype), walls[at[:, 0], at[:, 1]]), -1)


def unpack(packed: Tensor, params: LocaliserParams, size: int | None = None) -> Tensor:
    """The opposite of `pack`; cells outside the square, of the size of the parameters by default, are left out."""
    size = size or params.size
    walls, half = torch.zeros(size, size, 6), size // 2
    at = packed[:, :2].round().long()
    inside = ((at >= -half) & (at < half)).all(-1)
    column, row = (at[inside] + half).unbind(-1)
    walls[column, row] = packed[inside, 2:].to(walls.dtype)
    return walls
