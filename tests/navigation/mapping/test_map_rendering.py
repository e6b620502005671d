"""A map is drawn where its parts are known to be when it is asked for."""

import pytest
import torch

from ndtorch.navigation import Grid, GridMap, Pose, Ranges, StereoRig
from ndtorch.navigation.mapping.map_rendering import informative, render, thresholded
from ndtorch.navigation.mapping.range_log import FramePose, Frames, add_ranges, empty_log, in_world

GRID = Grid(0.0, 6.0, -2.0, 2.0)


def seen(rig, x, y=0.0):
    """One feature, ranged at a place of the body frame."""
    ahead = x - rig.forward
    left, right = (torch.atan2(torch.tensor(y + side * rig.baseline / 2), torch.tensor(ahead)) for side in (-1, 1))
    distance = torch.hypot(torch.tensor(ahead), torch.tensor(y - rig.baseline / 2))
    parts = (distance, left, right, torch.tensor(x), torch.tensor(y), torch.tensor(True))
    return Ranges(*(part.reshape(1, 1) for part in parts))


def peak(cells):
    row, column = divmod(int(cells.argmax()), cells.shape[-1])
    return [float(v) for v in GRID.center(torch.tensor(row), torch.tensor(column))]


def frames(*pose):
    return Frames(torch.tensor([3.0], dtype=torch.float64), torch.tensor([pose], dtype=torch.float64))


@pytest.mark.parametrize("certainty", ["beams", "log-odds"])
def test_the_map_moves_with_the_frame_it_was_seen_in(certainty):
    rig = StereoRig()
    grid_map = GridMap(rig, GRID, certainty=certainty)
    pose, ranges = Pose(*(torch.tensor([v]) for v in (1.0, 0.0, 0.0))), seen(rig, 1.5)
    first = Ranges(*(part[0] for part in ranges))
    state = grid_map.update(ranges, pose)._replace(log=add_ranges(empty_log(), FramePose(3, (1.0, 0.0, 0.0)), first))
    driven = GridMap.normalise(GRID.inner(state.cells))
    drawn = render(grid_map, state.log, frames(0.0, 0.0, 0.0))
    torch.testing.assert_close(drawn, thresholded(driven), rtol=1e-4, atol=1e-5)
    moved = render(grid_map, state.log, frames(1.0, 0.5, 0.0))
    (x, y), (there_x, there_y) = peak(drawn), peak(moved)
    assert (there_x - x, there_y - y) == pytest.approx((1.0, 0.5), abs=0.011)


def test_what_is_seen_again_from_one_place_counts_as_often_as_in_passing():
    """A place that is ranged a thousand times to and fro hides no other one that was passed once."""
    rig, log = StereoRig(), empty_log()
    for n in range(1000):  # a few millimetres to and fro: not twice from the same pose
        here = FramePose(3, (0.075 + 1e-5 * n, 0.075, 0.0))
        log = add_ranges(log, here, Ranges(*(part[0] for part in seen(rig, 1.5, 0.6))))
    assert len(log.present) == 1000
    passed = Ranges(*(part[0] for part in seen(rig, 1.5, -0.6)))
    for n in range(5):
        log = add_ranges(log, FramePose(3, (2.075 + 0.03 * n, 0.075, 0.0)), passed)
    ranges, poses = in_world(log, frames(0.0, 0.0, 0.0))
    kept = informative(ranges, poses)
    assert kept.nonzero().flatten().tolist() == [*range(5), *range(1000, 1005)]
    drawn = render(GridMap(rig, GRID), log, frames(0.0, 0.0, 0.0))
    row, column = GRID.find(torch.tensor(3.635), torch.tensor(-0.525))
    assert float(drawn[int(row) - 16 : int(row) + 16, int(column) - 16 : int(column) + 16].max()) > 0.2
