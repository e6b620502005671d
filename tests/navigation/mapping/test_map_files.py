"""Maps as files: what is written is read again, and ROS finds every wall where it is."""

import numpy as np
import pytest
import torch

from ndtorch.navigation import AlphaBetaTracker, DeadReckoning, Grid, Pose, Ranges
from ndtorch.navigation.mapping.feature_tracks import FeatureTrackParams
from ndtorch.navigation.mapping.map_files import FREE, OCCUPIED, UNKNOWN, load_map, save_map
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
