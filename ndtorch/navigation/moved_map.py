"""A map whose parts move: kept as sights, and drawn where they are known to be by then.

What is drawn stays where it was, whatever is found out later about the pose from which it was seen. So a map beside a
localiser keeps what it is drawn from, which costs a step next to nothing, and is drawn anew when it is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from ndtorch.navigation.localisation.anchors import located_frames
from ndtorch.navigation.mapping import GridMap, GridMapState
from ndtorch.navigation.odometry import Pose, to_world
from ndtorch.navigation.ranging import Ranges
from ndtorch.navigation.sights import Anchor, Frames, Sights, add_sights, no_sights, placed_sights
from ndtorch.navigation.state import NavigatorState

CHUNK = 256
"""Sights that are drawn at once: as many as fit into the cache with all their places."""

EVIDENT = 0.05
"""Cells of less than this share of a map's largest are no evidence of anything."""

NEARBY, TIMES = 0.15, 5
"""Squares of a map, m, and how many sights of a place in one of them, from one of them, count: about as many as a car
has that drives through once."""


def keep(state: GridMapState, ranges: Ranges, anchors: Sequence[Anchor | None]) -> GridMapState:
    """The state with sights from which the map can be drawn anew when frames have moved.

    Args:
        ranges: `[T, n]`, as `GridMap.update` was given them.
        anchors: where each was seen from; None where that is not known, which is not kept.
    """
    sights = no_sights() if state.sights is None else state.sights
    for t, anchor in enumerate(anchors):
        if anchor is not None:
            sights = add_sights(sights, anchor, Ranges(*(part[t] for part in ranges)))
    return state._replace(sights=sights)


def draw(grid_map: GridMap, sights: Sights, frames: Frames) -> Tensor:
    """Cells `[rows, columns]` of sights where their frames are now, normalised and `evident`; see `telling`."""
    ranges, poses = placed_sights(sights, frames)
    kept = telling(ranges, poses)
    ranges, poses = Ranges(*(part[kept] for part in ranges)), Pose(*(part[kept] for part in poses))
    state: GridMapState | None = None
    for k in range(0, len(poses.x), CHUNK):
        some = Ranges(*(part[k : k + CHUNK] for part in ranges))
        state = grid_map.update(some, Pose(*(part[k : k + CHUNK] for part in poses)), state)
    if state is None:
        return torch.zeros(grid_map.grid.rows, grid_map.grid.columns)
    return evident(GridMap.normalise(grid_map.grid.inner(state.cells)))


def telling(ranges: Ranges, poses: Pose) -> Tensor:
    """Which sights `[m, 1]` from poses `[m]` say more than those before them, bool `[m]`.

    What is seen again and again from one place is no better known by it: a car that goes round in one room would give
    all of the map's evidence to that room.
    """
    x, y = to_world(poses, ranges.x[:, 0], ranges.y[:, 0])
    squares = torch.stack([(part / NEARBY).floor().long() for part in (poses.x, poses.y, x, y)], -1)
    which = torch.unique(squares, dim=0, return_inverse=True)[1]
    order = which.argsort(stable=True)
    alike = which[order]
    before = torch.empty_like(order)
    before[order] = torch.arange(len(order)) - torch.searchsorted(alike, alike)
    return before < TIMES


def map_cells(grid_map: GridMap, state: NavigatorState | None) -> Tensor:
    """The map of a navigator as far as is known now, normalised; zeros before anything was seen.

    Beside a localiser it is drawn anew, with every part where the localiser has it by now. That takes a second after
    twenty minutes of driving. `state.map.cells` is the map as it was drawn on the way.
    """
    grid = grid_map.grid
    if state is None or state.map is None:
        return torch.zeros(grid.rows, grid.columns)
    if state.map.sights is None or state.located is None:
        return GridMap.normalise(grid.inner(state.map.cells))
    return draw(grid_map, state.map.sights, located_frames(state.located))


def evident(cells: Tensor) -> Tensor:
    """Normalised cells without those that are less than a twentieth.

    False ranges fall anywhere, and rarely often into one place; what is there is ranged from many places.
    """
    return torch.where(cells >= EVIDENT, cells, 0.0)
