"""The grid map, the log-odds map, tiles, the observation list, feature tracks, and maps as files."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ndtorch.navigation import AlphaBetaTracker, DeadReckoning, Grid, GridMap, ObservationList, Pose, Ranges, StereoRig
from ndtorch.navigation.mapping.certainty import certainty
from ndtorch.navigation.mapping.grid_map import LIMIT
from ndtorch.navigation.mapping.map_files import FREE, OCCUPIED, UNKNOWN, load_map, save_map
from tests.navigation.planar_world import to_body

RIG = StereoRig()
GRID = Grid(-1.0, 5.0, -3.0, 3.0)


def ranges_of(points, valid=None, rig=RIG):
    """Ranges of points of the body frame, `[..., T, n, 2]`."""
    points = torch.as_tensor(points, dtype=torch.float32)
    x, y = points.unbind(-1)
    left, right = torch.atan2(y - rig.baseline / 2, x), torch.atan2(y + rig.baseline / 2, x)
    valid = torch.ones(x.shape, dtype=torch.bool) if valid is None else torch.as_tensor(valid)
    return Ranges(torch.hypot(x, y - rig.baseline / 2), left, right, x, y, valid)


def poses(*values):
    return Pose(*torch.tensor(values, dtype=torch.float32).unbind(-1))


def random_run(seed, *batch, steps=6, count=3):
    generator = torch.Generator().manual_seed(seed)
    points = torch.rand(*batch, steps, count, 2, generator=generator) * torch.tensor([1.4, 1.6])
    points = points + torch.tensor([0.7, -0.8])
    pose = torch.rand(*batch, steps, 3, generator=generator) * torch.tensor([1.5, 1.0, 0.6])
    valid = torch.rand(*batch, steps, count, generator=generator) < 0.7
    return ranges_of(points, valid), Pose(*pose.unbind(-1))


def test_cells_against_fine_sampling_of_the_formula():
    """Mean of the printed certainty over every cell, from 5x5 points each, at a turned and shifted pose."""
    grid, fine = Grid(0.0, 3.0, -0.5, 2.5), 5
    ranges, pose = ranges_of([[[1.6, 0.3], [1.1, -0.2]]]), poses([0.4, 0.2, 0.5])
    cells, _ = GridMap(RIG, grid)(ranges, pose)
    place = (torch.arange(300 * fine, dtype=torch.float64) + 0.5) / (100 * fine)
    wanted = torch.zeros(300 * fine, 300 * fine, dtype=torch.float64)
    x, y = to_body(pose, place.unsqueeze(0), (place - 0.5).unsqueeze(1))
    for k in range(2):
        wanted += certainty(x, y, Ranges(*(part[0, k] for part in ranges)), RIG)
    wanted = wanted.reshape(300, fine, 300, fine).mean((1, 3))
    assert float(cells.sum()) == pytest.approx(float(wanted.sum()), rel=0.01)
    assert float((cells - wanted).square().mean().sqrt()) < 0.08 * float(wanted.square().mean().sqrt())
    for k in range(2):
        # The center of each blob lies where the feature is seen.
        part, _ = GridMap(RIG, grid)(ranges._replace(valid=torch.tensor([[k == 0, k == 1]])), pose)
        row, column = divmod(int(part.argmax()), 300)
        x, y = to_body(pose, *grid.center(torch.tensor(row), torch.tensor(column)))
        assert float(x) == pytest.approx(float(ranges.x[0, k]), abs=0.03)
        assert float(y) == pytest.approx(float(ranges.y[0, k]), abs=0.02)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_the_map_is_never_negative_and_only_grows(seed):
    ranges, pose = random_run(seed)
    mapper = GridMap(RIG, GRID)
    first, state = mapper(ranges, pose)
    first = first.clone()
    second, _ = mapper(ranges, pose, state)
    assert (first >= 0).all()
    torch.testing.assert_close(second, 2 * first)
    normal = mapper.normalise(second)
    assert float(normal.max()) == (1.0 if ranges.valid.any() else 0.0)


@pytest.mark.parametrize("certainty", ["beams", "log-odds"])
def test_an_old_state_stays_as_it_was(certainty):
    """Whoever keeps a state can go on from it, as often as wanted; nothing is changed behind anybody's back."""
    mapper = GridMap(RIG, GRID, certainty=certainty)
    first, later = random_run(3, 2), random_run(4, 2)
    _, kept = mapper(*first)
    before = kept.cells.clone()
    one, after = mapper(*later, kept)
    other, _ = mapper(*later, kept)
    assert torch.equal(kept.cells, before)
    assert torch.equal(one, other)
    assert not torch.equal(after.cells, before)
    # Tiles that were not touched are shared.
    tiles = [pair for rows in zip(kept.tiles, after.tiles, strict=True) for pair in zip(*rows, strict=True)]
    assert any(a is b for a, b in tiles)
    assert all(a is b or a.untyped_storage().data_ptr() != b.untyped_storage().data_ptr() for a, b in tiles)


def test_log_odds():
    mapper = GridMap(RIG, GRID, certainty="log-odds")
    look = ranges_of([[[1.5, 0.0]]]), poses([0.0, 0.0, 0.0])
    state = None
    for _ in range(10):
        cells, state = mapper(*look, state)
    probability = cells.sigmoid()
    at = lambda x, y: float(probability[round((y + 3) * 100), round((x + 1) * 100)])  # noqa: E731
    assert at(1.5, 0.0) > 0.6  # the feature
    assert at(0.8, 0.0) < 0.4  # the line of sight
    assert at(2.5, 0.0) == 0.5  # behind it nothing is known
    assert at(0.8, 0.5) == 0.5
    for _ in range(200):
        state = mapper.update(*look, state)
    assert float(state.cells.abs().max()) == LIMIT
    # It changes its mind: something is now seen through the place.
    further = ranges_of([[[2.1, 0.0]]]), look[1]
    for _ in range(200):
        cells, state = mapper(*further, state)
    probability = cells.sigmoid()
    assert at(1.5, 0.0) < 0.4


def test_list_keeps_the_newest_and_forgets():
    module = ObservationList(dt=0.5, capacity=4, lifetime=2.0)
    state = None
    for t in range(3):
        seen, state = module(ranges_of([[[1.0 + t, 0.0], [1.0, 1.0]]]), poses([0.0, 0.0, 0.0]), state)
    assert seen.x.tolist() == [3.0, 1.0, 2.0, 1.0]
    wanted = [1.0, 1.0, math.exp(-0.25), math.exp(-0.25)]
    assert seen.weight.tolist() == pytest.approx(wanted)
    turned, _ = module(ranges_of([[[1.0, 0.0]]], [[False]]), poses([2.0, 3.0, math.pi / 2]))
    assert (turned.weight == 0).all()
    assert (float(turned.x[0]), float(turned.y[0])) == pytest.approx((2.0, 4.0))
    assert turned.seen_from[0].tolist() == pytest.approx([2.0, 3.0, math.pi / 2])


FILED = Grid(-1.0, 2.0, -0.5, 1.53, 0.01)


def write(folder, **more):
    cells = torch.zeros(FILED.rows, FILED.columns)
    row, column = FILED.find(torch.tensor(1.22), torch.tensor(0.92))
    cells[row - 1, column - 1] = 1.0
    path = np.stack((np.linspace(-0.8, 0.4, 50), np.full(50, -0.2)), -1)
    save_map(folder, cells, FILED, path, **more)
    return cells


def test_a_map_is_read_again_as_it_was(tmp_path):
    ndt_cells = np.arange(16, dtype=np.float32).reshape(2, 8)
    cells = write(tmp_path, ndt_cells=ndt_cells, true_path=np.zeros((3, 3)))
    for place in (tmp_path, tmp_path / "map.npz"):
        read = load_map(place)
        assert read.grid == FILED
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
    tracker = AlphaBetaTracker(DT, slots=2)
    tracks, state = tracker(gone, pose)
    assert torch.isinf(tracks.unseen).all()
    tracks, _ = tracker(seen(walk([[2.0, 0.5]], [[0.0, 0.0]], 60), pose), pose, state)
    k = int(tracks.unseen.argmin())
    assert tracks.place[k].tolist() == pytest.approx([2.0, 0.5], abs=1e-4)
    assert float(tracks.age[k]) == pytest.approx(59 * DT, rel=1e-4)
