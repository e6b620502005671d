"""What a car knows to stand around it, as places and as the nearest distance in each direction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ndtorch.navigation import Navigator, NavigatorState, Ranges
from ndtorch.navigation.local_grid._kernels import LocalGrid

Floats = npt.NDArray[np.float64]


def seen_obstacles(state: NavigatorState, navigator: Navigator) -> Ranges:
    """Places `[n]` of what stands around a car, in the frame of its body, m: the ranges of the last frame, and the
    blocked cells that its controller remembers.
    """
    ranges = state.ranges
    valid = np.asarray(ranges.valid).reshape(-1)
    x, y = (np.asarray(part, np.float64).reshape(-1)[valid] for part in (ranges.x, ranges.y))
    ahead, left = blocked_cells(state, navigator)
    x, y = np.concatenate((x, ahead)), np.concatenate((y, left))
    return Ranges(np.hypot(x, y), np.arctan2(y, x), np.zeros_like(x), x, y, np.ones(x.shape, bool))


def blocked_cells(state: NavigatorState, navigator: Navigator) -> tuple[Floats, Floats]:
    """The middles of the blocked cells of the local grid, in the frame of the body, m; none without such a grid."""
    control = getattr(state.control, "reactive", state.control)
    grid = getattr(control, "grid", None)
    if not isinstance(grid, LocalGrid):
        return np.zeros(0), np.zeros(0)
    # A controller for another body reckons in units of it.
    unit = float(getattr(navigator.controller, "unit", 1.0))
    params = getattr(navigator.controller.params, "reactive", navigator.controller.params)
    evidence = np.maximum(grid.evidence, grid.raised) if grid.raised.size else grid.evidence
    rows, columns = np.nonzero(evidence >= params.blocked_evidence)
    size, cell = evidence.shape[0], params.grid.cell_m
    x, y = ((n + size * grid.tag[axis, n] + 0.5) * cell * unit for axis, n in enumerate((rows, columns)))
    pose = navigator.control_pose(state.pose, state.located)
    dx, dy, heading = x - float(pose.x), y - float(pose.y), float(pose.heading)
    cos, sin = math.cos(heading), math.sin(heading)
    return cos * dx + sin * dy, cos * dy - sin * dx


def nearest_by_sector(x: Floats, y: Floats, sectors: int) -> Floats:
    """The distance of the nearest place in each of some equal sectors, the first about +x and going on towards +y, m;
    infinite where there is none.
    """
    bearing = np.arctan2(y, x) * (sectors / (2 * math.pi))
    near: Any = np.full(sectors, math.inf)
    np.minimum.at(near, np.rint(bearing).astype(int) % sectors, np.hypot(x, y))
    found: Floats = near
    return found
