"""The rolling grid of evidence around a car, the path that it has driven, and the outlines of its arcs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.arguments import check_numbers
from ndtorch.errors import InputError
from ndtorch.navigation.body import Body
from ndtorch.navigation.local_grid._kernels import POSES, DrivenPath, LocalGrid, Primitives, cell_index, tags
from ndtorch.navigation.proximity import ProximityScan

Floats = npt.NDArray[Any]


@dataclass(frozen=True)
class LocalGridParams:
    """A square of square cells that moves with the car.

    Args:
        cell_m: Side of a cell.
        size_cells: Number of cells along a side, a power of two; what lies beyond is forgotten.
        lifetime_s: Time in which evidence falls to 1/e.
        max_evidence: Limit of the evidence of an obstacle, so that a few frames can free a cell.
        max_free_evidence: Limit of the evidence of free floor, so that four frames can block a cell.

    Raises:
        InputError: A number is out of range.
    """

    cell_m: float = 0.08
    size_cells: int = 64
    lifetime_s: float = 10.0
    max_evidence: float = 5.0
    max_free_evidence: float = 2.0

    def __post_init__(self) -> None:
        check_numbers(self, endless=["lifetime_s"], positive=vars(self))
        if not (self.size_cells >= 2 and self.size_cells & (self.size_cells - 1) == 0):
            raise InputError(f"size_cells must be a power of two, got {self.size_cells}")

    @property
    def reach(self) -> float:
        """Points nearer than this along either axis are inside, m."""
        return (self.size_cells // 2 - 1) * self.cell_m


def empty_grid(x: float, y: float, params: LocalGridParams, raised: bool = False) -> LocalGrid:
    """Nothing is known around a car at x, y, m; what is raised may be kept apart."""
    size = params.size_cells
    above = np.zeros((size, size) if raised else (0, 0), np.float32)
    return LocalGrid(np.zeros((size, size), np.float32), tags(float(x), float(y), params.cell_m, size), above)


def empty_path() -> DrivenPath:
    """Of a car that has not driven yet."""
    return DrivenPath(np.zeros((POSES, 3), np.float32), 0)


def mark_obstacles(
    grid: LocalGrid, pose: tuple[float, float, float], x: Floats, y: Floats, weight: float, params: LocalGridParams
) -> LocalGrid:
    """The grid with a range's evidence of raised obstacles in each of the cells that hold points of the body frame.

    What was seen free before there was any measurement that near says nothing.
    """
    if not len(x) or not grid.raised.size:
        return grid
    at, raised = cells_at(pose, x, y, params), grid.raised.copy()
    cells = raised.reshape(-1)
    cells[at] = np.minimum(np.maximum(cells[at], 0) + weight, params.max_evidence)
    return grid._replace(raised=raised)


def mark_stop(
    grid: LocalGrid,
    pose: tuple[float, float, float],
    scan: ProximityScan,
    blocked: float,
    params: LocalGridParams,
) -> LocalGrid:
    """The grid after a proximity check of a standing car.

    Obstacles block at once, and so does a line across the path where no floor is seen; mismatches do not.

    Args:
        blocked: evidence from which a cell blocks.
    """
    evidence, raised = grid.evidence.copy(), grid.raised.copy()
    cells, full = evidence.reshape(-1), blocked + 0.1
    ahead, none = cells_at(pose, *scan.across, params), cells_at(pose, *scan.mismatches, params)
    cells[ahead] = np.minimum(cells[ahead], 0) if scan.floor_seen else np.maximum(cells[ahead], full)
    for layer in (cells, raised.reshape(-1)):
        if layer.size:
            layer[none] = np.minimum(layer[none], 0)
    obstacles = cells_at(pose, *scan.obstacles, params)
    cells[obstacles] = np.maximum(cells[obstacles], full)
    return grid._replace(evidence=evidence, raised=raised)


def cells_at(pose: tuple[float, float, float], x: Floats, y: Floats, params: LocalGridParams) -> npt.NDArray[np.int32]:
    """Numbers of the cells that hold points of the body frame, m."""
    points = (np.ascontiguousarray(part, np.float32) for part in (x, y))
    at: npt.NDArray[np.int32] = cell_index(*points, pose, params.cell_m, params.size_cells)
    return at


def unrolled(evidence: Floats, x: float, y: float, params: LocalGridParams) -> tuple[Floats, float, float]:
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
    xs, ys = [], []
    for curvature, direction in arcs:
        # Driving backward along an arc mirrors the path that driving forward along it takes.
        bent = (s - lag).clip(min=0.0)
        turned = curvature * bent
        chord = bent * np.sinc(turned / 2 / math.pi)
        x, y = s - bent + chord * np.cos(turned / 2), chord * np.sin(turned / 2)
        cos, sin = np.cos(turned)[:, None], np.sin(turned)[:, None]
        xs.append(direction * (x[:, None] + cos * px - sin * py))
        ys.append(y[:, None] + sin * px + cos * py)
    kind = np.float32
    return Primitives(
        np.array([k for k, _ in arcs], kind),
        np.array([d for _, d in arcs], kind),
        np.stack(xs).ravel().astype(kind),
        np.stack(ys).ravel().astype(kind),
        len(across),
        steps,
        step,
    )
