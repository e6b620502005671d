"""Maps as files: what is written is read again, and ROS finds every wall where it is."""

import math

import numpy as np
import pytest
import torch

from ndtorch.navigation import AlphaBetaTracker, DeadReckoning, Grid, GridMap, Pose, Ranges, StereoRig
from ndtorch.navigation.mapping.feature_tracks import FeatureTrackParams
from ndtorch.navigation.mapping.map_files import FREE, OCCUPIED, UNKNOWN, load_map, save_map
from ndtorch.navigation.mapping.map_rendering import informative, render, thresholded
from ndtorch.navigation.mapping.range_log import (
    MAX_FRAME_RANGES,
    FramePose,
    Frames,
    add_ranges,
    empty_log,
    in_world,
    thinned,
)
from ndtorch.utils.tensors import leaves
from tests.navigation.planar_world import to_body

GRID = Grid(-1.0, 2.0, -0.5, 1.53, 0.01)


def write(folder, **more):
    cells = torch.zeros(GRID.rows, GRID.columns)
    row, column = GRID.find(torch.tensor(1.22), torch.tensor(0.92))
    cells[row - 1, column - 1] = 1.0
    path = np.stack((np.linspace(-0.8, 0.4, 50), np.full(50, -0.2)), -1)
    save_map(folder, cells, GRID, path, **more)
    return cells


def test_a_map_is_read_again_as_it_was(tmp_path):
    ndt_cells = np.arange(16, dtype=np.float32).reshape(2, 8)
    cells = write(tmp_path, ndt_cells=ndt_cells, true_path=np.zeros((3, 3)))
    for place in (tmp_path, tmp_path / "map.npz"):
        read = load_map(place)
        assert read.grid == GRID
        assert torch.equal(read.cells, cells)
        assert np.array_equal(read.ndt_cells, ndt_cells)
    write(tmp_path)
    assert load_map(tmp_path).ndt_cells is None


def test_ros_finds_walls_free_floor_and_the_unknown_where_they_are(tmp_path):
    write(tmp_path)
    header, size, most, pixels = (tmp_path / "map.pgm").read_bytes().split(b"\n", 3)
    columns, rows = map(int, size.split())
    assert (header, most, columns, rows) == (b"P5", b"255", 60, 41)
    image = np.frombuffer(pixels, np.uint8).reshape(rows, columns)
    said = dict(line.split(": ") for line in (tmp_path / "map.yaml").read_text().splitlines())
    assert (said["image"], said["resolution"], said["negate"]) == ("map.pgm", "0.05", "0")
    left, bottom, _ = (float(part) for part in said["origin"].strip("[]").split(","))

    def at(x, y):  # as map_server counts: the last row of the picture is at the origin
        return image[rows - 1 - int((y - bottom) / 0.05), int((x - left) / 0.05)]

    assert at(1.22, 0.92) == OCCUPIED
    assert (image == OCCUPIED).sum() == 1
    assert at(0.0, -0.2) == at(0.0, -0.07) == FREE
    # As far as a car reaches beside its way, three pixels, and no further.
    below = [at(0.0, -0.2 - 0.05 * n) for n in range(5)]
    assert below == [FREE] * 4 + [UNKNOWN]
    assert at(0.0, 0.1) == at(1.0, -0.2) == UNKNOWN


DRAWN = Grid(0.0, 6.0, -2.0, 2.0)


def seen_map(rig, x, y=0.0):
    """One feature, ranged at a place of the body frame."""
    ahead = x - rig.forward
    left, right = (torch.atan2(torch.tensor(y + side * rig.baseline / 2), torch.tensor(ahead)) for side in (-1, 1))
    distance = torch.hypot(torch.tensor(ahead), torch.tensor(y - rig.baseline / 2))
    parts = (distance, left, right, torch.tensor(x), torch.tensor(y), torch.tensor(True))
    return Ranges(*(part.reshape(1, 1) for part in parts))


def peak(cells):
    row, column = divmod(int(cells.argmax()), cells.shape[-1])
    return [float(v) for v in DRAWN.center(torch.tensor(row), torch.tensor(column))]


def drawn_frames(*pose):
    return Frames(torch.tensor([3.0], dtype=torch.float64), torch.tensor([pose], dtype=torch.float64))


@pytest.mark.parametrize("certainty", ["beams", "log-odds"])
def test_the_map_moves_with_the_frame_it_was_seen_in(certainty):
    rig = StereoRig()
    grid_map = GridMap(rig, DRAWN, certainty=certainty)
    pose, ranges = Pose(*(torch.tensor([v]) for v in (1.0, 0.0, 0.0))), seen_map(rig, 1.5)
    first = Ranges(*(part[0] for part in ranges))
    state = grid_map.update(ranges, pose)._replace(log=add_ranges(empty_log(), FramePose(3, (1.0, 0.0, 0.0)), first))
    driven = GridMap.normalise(DRAWN.inner(state.cells))
    drawn = render(grid_map, state.log, drawn_frames(0.0, 0.0, 0.0))
    torch.testing.assert_close(drawn, thresholded(driven), rtol=1e-4, atol=1e-5)
    moved = render(grid_map, state.log, drawn_frames(1.0, 0.5, 0.0))
    (x, y), (there_x, there_y) = peak(drawn), peak(moved)
    assert (there_x - x, there_y - y) == pytest.approx((1.0, 0.5), abs=0.011)


def test_what_is_seen_again_from_one_place_counts_as_often_as_in_passing():
    """A place that is ranged a thousand times to and fro hides no other one that was passed once."""
    rig, log = StereoRig(), empty_log()
    for n in range(1000):  # a few millimetres to and fro: not twice from the same pose
        here = FramePose(3, (0.075 + 1e-5 * n, 0.075, 0.0))
        log = add_ranges(log, here, Ranges(*(part[0] for part in seen_map(rig, 1.5, 0.6))))
    assert len(log.present) == 1000
    passed = Ranges(*(part[0] for part in seen_map(rig, 1.5, -0.6)))
    for n in range(5):
        log = add_ranges(log, FramePose(3, (2.075 + 0.03 * n, 0.075, 0.0)), passed)
    ranges, poses = in_world(log, drawn_frames(0.0, 0.0, 0.0))
    kept = informative(ranges, poses)
    assert kept.nonzero().flatten().tolist() == [*range(5), *range(1000, 1005)]
    drawn = render(GridMap(rig, DRAWN), log, drawn_frames(0.0, 0.0, 0.0))
    row, column = DRAWN.find(torch.tensor(3.635), torch.tensor(-0.525))
    assert float(drawn[int(row) - 16 : int(row) + 16, int(column) - 16 : int(column) + 16].max()) > 0.2


DT = 1 / 30


def seen(points, pose, noise=0.0, seed=0):
    """Ranges of world points `[T, n, 2]` from poses `[T]`, with range noise along the line of sight."""
    x, y = to_body(Pose(*(part.unsqueeze(-1) for part in pose)), *points.unbind(-1))
    generator = torch.Generator().manual_seed(seed)
    stretch = 1 + noise * torch.randn(x.shape, generator=generator)
    x, y = x * stretch, y * stretch
    return Ranges(torch.hypot(x, y), x * 0, x * 0, x, y, torch.ones_like(x, dtype=torch.bool))


def walk(starts, velocities, steps):
    time = torch.arange(steps).reshape(-1, 1, 1) * DT
    return torch.tensor(starts) + torch.tensor(velocities) * time


STILL = [[2.0, 0.8], [2.5, -0.7], [1.6, 0.0]]


@pytest.mark.parametrize("curvature", [0.0, 1.0, -0.5])
def test_moving_car_in_a_static_world(curvature):
    """The image of everything moves, yet no track is dynamic, at 2 % of range noise."""
    steps = 90
    pose, _ = DeadReckoning(DT)(torch.full((steps,), 0.5), torch.full((steps,), curvature))
    points = walk(STILL, [[0.0, 0.0]] * 3, steps)
    state = None
    for t in range(steps):
        now = slice(t, t + 1)
        tracks, state = AlphaBetaTracker(DT)(
            Ranges(*(p[now] for p in seen(points, pose, noise=0.02))), Pose(*(p[now] for p in pose)), state
        )
        assert not tracks.dynamic.any()
    assert int((state.unseen == 0).sum()) == 3


def test_a_walker_is_flagged_and_predicted():
    steps = 90
    pose, _ = DeadReckoning(DT)(torch.full((steps,), 0.5), torch.zeros(steps))
    points = walk([*STILL, [3.0, -0.8]], [[0.0, 0.0]] * 3 + [[-0.1, 0.6]], steps)
    tracks, _ = AlphaBetaTracker(DT)(seen(points, pose, noise=0.01), pose)
    assert int(tracks.dynamic.sum()) == 1
    k = int(tracks.dynamic.nonzero())
    assert tracks.velocity[k].tolist() == pytest.approx([-0.1, 0.6], abs=0.15)
    assert tracks.place[k].tolist() == pytest.approx(points[-1, 3].tolist(), abs=0.06)


def test_tracks_end_and_slots_are_reused():
    pose = Pose(*torch.zeros(3, 60))
    ranges = seen(walk([[1.0, 0.0]], [[0.0, 0.0]], 60), pose)
    gone = ranges._replace(valid=ranges.valid & (torch.arange(60) < 20).unsqueeze(-1))
    tracker = AlphaBetaTracker(DT, FeatureTrackParams(slots=2, max_lost_s=0.5))
    tracks, state = tracker(gone, pose)
    assert torch.isinf(tracks.unseen).all()
    tracks, _ = tracker(seen(walk([[2.0, 0.5]], [[0.0, 0.0]], 60), pose), pose, state)
    k = int(tracks.unseen.argmin())
    assert tracks.place[k].tolist() == pytest.approx([2.0, 0.5], abs=1e-4)
    assert float(tracks.age[k]) == pytest.approx(59 * DT, rel=1e-4)


def ranges(*ahead):
    """So many features straight ahead; None is a slot that is not valid."""
    x = torch.tensor([0.0 if v is None else v for v in ahead])
    valid = torch.tensor([v is not None for v in ahead])
    return Ranges(x, -0.1 * valid, 0.1 * valid, x, 0 * x, valid)


def frames(**poses):
    numbers = torch.tensor([float(name[1:]) for name in poses], dtype=torch.float64)
    return Frames(numbers, torch.tensor(list(poses.values()), dtype=torch.float64).reshape(-1, 3))


def test_sights_move_with_their_frames():
    log = add_ranges(empty_log(), FramePose(0, (1.0, 0.0, 0.0)), ranges(2.0, None))
    log = add_ranges(log, FramePose(0, (1.0, 0.5, 0.1)), ranges(None, None))
    log = add_ranges(log, FramePose(7, (0.0, 0.0, 0.0)), ranges(1.0, 1.5))
    found, poses = in_world(log, frames(f0=(0, 0, 0), f7=(3, 1, 0.2)))
    assert found.x.flatten().tolist() == [2.0, 1.0, 1.5]
    assert bool(found.valid.all())
    assert torch.stack(poses, -1).tolist() == [pytest.approx(v) for v in ((1, 0, 0), (3, 1, 0.2), (3, 1, 0.2))]
    _, poses = in_world(log, frames(f0=(5, 0, math.pi / 2), f7=(0, 0, 0)))
    assert [float(part[0]) for part in poses] == pytest.approx([5.0, 1.0, math.pi / 2])


def test_each_number_of_a_range_stays_what_it_was_and_its_pose_is_turned_with_the_frame():
    numbers = torch.tensor([[2.0, -0.3, 0.2, 1.9, 0.4], [3.0, -0.1, 0.6, 2.8, -0.5]])
    seen = Ranges(*numbers.unbind(-1), torch.tensor([True, True]))
    log = add_ranges(empty_log(), FramePose(4, (1.0, 2.0, 0.3)), seen)
    found, pose = in_world(log, frames(f4=(10, 20, math.pi / 6)))
    assert [part.shape for part in found] == [(2, 1)] * 6
    torch.testing.assert_close(torch.cat(found[:-1], -1), numbers)
    cos, sin = math.cos(math.pi / 6), math.sin(math.pi / 6)
    wanted = (10 + cos - 2 * sin, 20 + sin + 2 * cos, 0.3 + math.pi / 6)
    assert [part.tolist() for part in pose] == [pytest.approx([v] * 2) for v in wanted]


def test_what_a_standing_car_sees_counts_once():
    log = add_ranges(empty_log(), FramePose(3, (0.1, 0.0, 0.0)), ranges(None))
    for _ in range(4):
        log = add_ranges(log, FramePose(3, (0.1, 0.0, 0.0)), ranges(1.0, 2.0))
    assert len(log.present) == 2
    log = add_ranges(log, FramePose(3, (0.1, 0.0, 0.01)), ranges(1.0, 2.0))
    assert len(log.present) == 4


def test_a_frame_that_ends_in_another_moves_with_it():
    home = FramePose(2, (1.0, 0.0, math.pi / 2))
    log = add_ranges(empty_log(), FramePose(5, (0.5, 0.0, 0.1)), ranges(2.0))
    log = add_ranges(log, FramePose(6, (0.0, 0.0, 0.0)), ranges(1.0), {5.0: home}.get)
    log = add_ranges(log, FramePose(7, (0.0, 0.0, 0.0)), ranges(), lambda frame: None)
    found, poses = in_world(log, frames(f2=(0, 0, 0), f5=(9, 9, 9), f6=(9, 9, 9)))
    assert found.x.flatten().tolist() == [2.0]
    assert [float(part) for part in poses] == pytest.approx([1.0, 0.5, 0.1 + math.pi / 2])


def test_the_log_grows_with_the_rooms_and_not_with_the_rounds():
    """Rounds through six rooms, each of a frame that ends in that of the first round."""
    chance, log, sizes = torch.Generator().manual_seed(0), empty_log(), []
    for lap in range(24):
        for room in range(6):
            for step in range(12):
                number = 6.0 * lap + room
                x = 1 + 3 * torch.rand(80, generator=chance)
                seen = Ranges(x, -0.1 + 0 * x, 0.1 + 0 * x, x, 0 * x, x > 0)
                at = FramePose(number, (0.25 * step, 0.0, 0.0))
                log = add_ranges(log, at, seen, lambda frame: FramePose(frame % 6, (0.0, 0.001 * frame, 0.0)))
        sizes.append(sum(part.numel() * part.element_size() for part in leaves(log).values()))
    assert sizes[-1] <= 1.01 * sizes[5]
    assert max(map(len, log.ended)) <= MAX_FRAME_RANGES
    assert set(log.numbers.tolist()) == set(range(6))


def test_what_was_seen_once_outlasts_what_is_seen_again():
    here, there = (torch.tensor([[2.0, -0.1, 0.1, 2.0, 0.0, *pose, 0.0]]) for pose in ((0.0, 0.0), (1.0, 0.0)))
    kept = thinned(torch.cat((here.repeat(2 * MAX_FRAME_RANGES, 1), there)))
    assert len(kept) <= MAX_FRAME_RANGES
    assert torch.equal(kept[-1:], there)
    apart = torch.arange(3.0 * MAX_FRAME_RANGES)[:, None] * torch.eye(8)[5] + here
    assert len(thinned(apart)) == MAX_FRAME_RANGES
