"""Rendering of a map whose submaps move: ranges are logged while driving and rendered where they are known to be.

A cell that was filled while driving stays where it was, whatever a loop closure changes later. So a map beside a
localiser logs its ranges, which takes a step next to no time, and is rendered when it is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ndtorch.navigation.localisation.state import map_frames
from ndtorch.navigation.mapping.grid_map import GridMap, GridMapState
from ndtorch.navigation.mapping.range_log import FramePose, Frames, RangeLog, add_ranges, empty_log, in_world
from ndtorch.navigation.odometry import Pose, to_world
from ndtorch.navigation.state import NavigatorState
from ndtorch.navigation.stereo.ranging import Ranges

CHUNK = 256
"""Ranges that are rendered at once: with all their samples they fit into the cache."""

MIN_RATIO = 0.05
"""Cells of less than this share of the largest are set to zero."""

SQUARE_M, MAX_VIEWS = 0.15, 5
"""Side of a square, and how many ranges of a place in one square count from poses in another: as many as a car makes
that passes once."""


def log_ranges(state: GridMapState, ranges: Ranges, poses: Sequence[FramePose | None]) -> GridMapState:
    """The state with ranges `[T, n]` logged at poses in frames; those without a pose are left out."""
    log = empty_log() if state.log is None else state.log
    for t, pose in enumerate(poses):
        if pose is not None:
            log = add_ranges(log, pose, Ranges(*(part[t] for part in ranges)))
    return state._replace(log=log)


def render(grid_map: GridMap, log: RangeLog, frames: Frames) -> Tensor:
    """Normalised cells `[rows, columns]` of `informative` ranges at the present poses of their frames."""
    ranges, poses = in_world(log, frames)
    kept = informative(ranges, poses)
    ranges, poses = Ranges(*(part[kept] for part in ranges)), Pose(*(part[kept] for part in poses))
    state: GridMapState | None = None
    for k in range(0, len(poses.x), CHUNK):
        some = Ranges(*(part[k : k + CHUNK] for part in ranges))
        state = grid_map.update(some, Pose(*(part[k : k + CHUNK] for part in poses)), state)
    if state is None:
        return torch.zeros(grid_map.grid.rows, grid_map.grid.columns)
    return thresholded(GridMap.normalise(grid_map.grid.inner(state.cells)))


def informative(ranges: Ranges, poses: Pose) -> Tensor:
    """Which ranges `[m, 1]` from poses `[m]` are not yet repeated `MAX_VIEWS` times, bool `[m]`.

    Without this a car that circles in one room would give that room nearly all evidence of the map.
    """
    x, y = to_world(poses, ranges.x[:, 0], ranges.y[:, 0])
    squares = torch.stack([(part / SQUARE_M).floor().long() for part in (poses.x, poses.y, x, y)], -1)
    group = torch.unique(squares, dim=0, return_inverse=True)[1]
    order = group.argsort(stable=True)
    ordered = group[order]
    before = torch.empty_like(order)
    before[order] = torch.arange(len(order)) - torch.searchsorted(ordered, ordered)
    return before < MAX_VIEWS


def map_cells(grid_map: GridMap, state: NavigatorState | None) -> Tensor:
    """The normalised map of a navigator as far as is known now; zeros before anything was seen.

    Beside a localiser it is rendered with all submaps at their present poses, which takes a second after twenty minutes
    of driving. `state.map.cells` is the map as it was filled while driving.
    """
    grid = grid_map.grid
    if state is None or state.map is None:
        return torch.zeros(grid.rows, grid.columns)
    if state.map.log is None or state.located is None:
        return GridMap.normalise(grid.inner(state.map.cells))
    return render(grid_map, state.map.log, map_frames(state.located))


def thresholded(cells: Tensor) -> Tensor:
    """Normalised cells with those below a twentieth set to zero, as false ranges rarely fall into one place twice."""
    return torch.where(cells >= MIN_RATIO, cells, 0.0)
