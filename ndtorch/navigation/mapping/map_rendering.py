"""Rendering of a map whose submaps move: ranges are logged while driving and rendered where they are known to be.

A cell that was filled while driving stays where it was, whatever a loop closure changes later. So a map beside a
localiser logs its ranges, which takes a step next to no time, and is rendered when it is asked for.
"""

from __future__ import annotations

from functools import partial

import torch
from torch import Tensor

from ndtorch.navigation.localisation.state import LocaliserState, frame_pose, lasting_frame, map_frames
from ndtorch.navigation.mapping.grid_map import GridMap, GridMapState
from ndtorch.navigation.mapping.range_log import Frames, RangeLog, add_ranges, empty_log, in_world, repetitions
from ndtorch.navigation.odometry import Pose
from ndtorch.navigation.state import NavigatorState
from ndtorch.navigation.stereo.ranging import Ranges

CHUNK = 256
"""Ranges that are rendered at once: with all their samples they fit into the cache."""

MIN_RATIO = 0.05
"""Cells of less than this share of the largest are set to zero."""

MAX_VIEWS = 5
"""Ranges of one place that count from another: as many as a car makes that passes once."""


def log_ranges(state: GridMapState, ranges: Ranges, located: LocaliserState) -> GridMapState:
    """The state with ranges `[n]` logged in the present frame of a localiser; as it is during relocalisation."""
    at = frame_pose(located)
    if at is None:
        return state
    log = empty_log() if state.log is None else state.log
    return state._replace(log=add_ranges(log, at, ranges, partial(lasting_frame, located)))


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
    return repetitions(poses, ranges.x[:, 0], ranges.y[:, 0]) < MAX_VIEWS


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
