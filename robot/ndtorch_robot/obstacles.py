"""Places of what a car knows to stand around it, and the nearest distance in each direction."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ndtorch.navigation import Navigator, NavigatorState, Ranges
from ndtorch.navigation.controllers.ranging._kernels import BLOCKED
from ndtorch.navigation.local_grid import LocalGrid
from ndtorch.navigation.state import pose_like

Floats = npt.NDArray[np.float64]


def seen_obstacles(state: NavigatorState, navigator: Navigator) -> Ranges:
    """Places `[n]` of obstacles around a car, in the frame of its body, m: the ranges of the last frame, and the
    blocked cells of the local grid that its controller remembers, if it has one.
    """
    valid = np.asarray(state.ranges.valid).reshape(-1)
    x, y = (np.asarray(part, np.float64).reshape(-1)[valid] for part in (state.ranges.x, state.ranges.y))
    grid = getattr(getattr(state.control, "reactive", state.control), "grid", None)
    if isinstance(grid, LocalGrid):
        params = getattr(navigator.controller.params, "reactive", navigator.controller.params).grid
        evidence = np.maximum(grid.evidence, grid.raised) if grid.raised.size else grid.evidence
        cells, side = np.nonzero(evidence >= BLOCKED), params.cell_m * navigator.unit_m
        dx, dy = ((n + len(evidence) * grid.tag[axis, n] + 0.5) * side for axis, n in enumerate(cells))
        pose = state.pose
        if state.located is not None and navigator.controller.has_goals:
            pose = pose_like(pose, state.located.odometry)
        dx, dy, heading = dx - float(pose.x), dy - float(pose.y), float(pose.heading)
        cos, sin = math.cos(heading), math.sin(heading)
        x, y = np.concatenate((x, cos * dx + sin * dy)), np.concatenate((y, cos * dy - sin * dx))
    return Ranges(np.hypot(x, y), np.arctan2(y, x), np.zeros_like(x), x, y, np.ones(x.shape, bool))


def nearest_by_sector(x: Floats, y: Floats, sectors: int) -> Floats:
    """The distance of the nearest place in each of some equal sectors, the first about +x and going on towards +y, m;
    infinite where there is none.
    """
    near = np.full(sectors, math.inf)
    sector = np.rint(np.arctan2(y, x) * (sectors / (2 * math.pi))).astype(int) % sectors
    np.minimum.at(near, sector, np.hypot(x, y))
    return near
