"""Localisation in a small room drawn by ray casting: truth that knows nothing of the library."""

import math
import pickle
import zlib

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import NavigatorOptions, Pose, StereoRig, save_map
from ndtorch.navigation.localisation.localiser import CELL_M, MAP_CELLS, Localiser
from ndtorch.navigation.localisation.ndt import Scan, add_scan, empty_map, from_sparse, match_scan, to_sparse
from ndtorch.navigation.localisation.odometry import (
    Motion,
    advance,
    fuse,
    fused_pose,
    motion_since_scan,
    start_odometry,
    visual_motion,
    with_keyframe,
)
from ndtorch.navigation.mapping.grid_map import Grid
from ndtorch.navigation.odometry import arc
from tests.navigation.planar_world import PlanarWorld

DT = 0.2
RIG = StereoRig()
CORNERS = np.array([(-3, -2.4), (2.6, -2.4), (2.6, 1.2), (1.4, 2.2), (-3, 2.2)], float)
"""A room with one oblique wall."""


def pose_of(values):
    return Pose(*(float(value) for value in values))


def room():
    """The room as a textured world."""
    return PlanarWorld(np.stack((CORNERS, np.roll(CORNERS, -1, 0)), 1), panels=(0.08, 0.5), seed=3)


@pytest.fixture(scope="module")
def drive():
    """True poses of two rounds, what was driven between them, and both rows seen from each."""
    poses, driven = [(0.0, -1.2, 0.0)], []
    for _ in range(150):
        driven.append((0.5, 0.9))
        poses.append(arc(Pose(*poses[-1]), *driven[-1], DT))
    left, right, _ = room().drive(poses)
    return np.array(poses), driven, np.stack((left, right), 1).astype(np.float32)


def reckon(start, driven, scale, drift):
    """Dead reckoning with an error of scale and a drift, radians/s."""
    poses = [tuple(start)]
    for speed, curvature in driven:
        speed, turn = speed * (1 + scale), speed * curvature + drift
        poses.append(arc(Pose(*poses[-1]), speed, turn / speed, DT))
    return np.array(poses)


def run(localiser, rows, reckoned, state=None):
    poses = []
    for row, pose in zip(rows, reckoned, strict=True):
        state = localiser(row, pose_of(pose), state)
        poses.append(state.pose)
    return np.array(poses), state


def test_it_stays_on_the_path_when_dead_reckoning_drifts_away(drive):
    poses, driven, rows = drive
    reckoned = reckon(poses[0], driven, 0.04, math.radians(0.5))
    away = np.hypot(*(reckoned - poses)[:, :2].T)
    assert away[-1] > 0.25
    located, state = run(Localiser(RIG, DT), rows, reckoned)
    error = located - poses
    assert np.median(np.hypot(*error[:, :2].T)) < 0.05
    assert np.hypot(*error[-1, :2]) < 0.25 * away[-1]
    assert abs(error[-1, 2]) < math.radians(2)
    # It has calibrated the wheels: in a car that always turns, bend and drift are one.
    scale, bend, drift = state.wheels.errors.tolist()
    turn = 0.5 * 0.9 * DT + math.radians(0.5) * DT
    assert drift * DT + (bend + scale) * turn == pytest.approx(math.radians(0.5) * DT, rel=0.3)
    assert scale == pytest.approx(0.04 / 1.04, abs=0.015)
    # The means of the cells lie on walls.
    cells = to_sparse(state.ndt_map)
    cells = cells[cells[:, 2] > 1.5]
    mean = (cells[:, :2] + 0.5) * CELL_M + cells[:, 3:5] / cells[:, 2:3]
    begin, along = CORNERS, np.roll(CORNERS, -1, 0) - CORNERS
    unit = along / np.hypot(*along.T)[:, None]
    offset = mean[:, None] - begin
    assert np.median(np.abs(offset[..., 0] * unit[:, 1] - offset[..., 1] * unit[:, 0]).min(1)) < 0.03
    kept = state._replace(ndt_map=to_sparse(state.ndt_map))
    assert len(zlib.compress(pickle.dumps(kept))) < 16_000


def test_a_drive_in_a_known_map_starts_a_little_beside_the_given_pose(drive):
    poses, driven, rows = drive
    _, state = run(Localiser(RIG, DT), rows[:75], poses[:75])
    reckoned = reckon(poses[75] + (0.08, -0.06, 0.04), driven[75:], 0.02, 0.0)
    located, _ = run(Localiser(RIG, DT, state.ndt_map), rows[75:], reckoned)
    error = np.hypot(*(located - poses[75:])[:, :2].T)
    assert np.median(error[10:]) < 0.04
    assert np.median(np.hypot(*(reckoned - poses[75:])[:, :2].T)) > 0.08


def test_a_standing_car_learns_nothing_from_what_it_ranges_again(drive):
    poses, _, rows = drive
    localiser = Localiser(RIG, DT)
    _, before = run(localiser, rows[:20], poses[:20])
    _, state = run(localiser, rows[19:20].repeat(30, 0), poses[19:20].repeat(30, 0), before)
    assert np.array_equal(state.ndt_map, before.ndt_map)
    assert np.array_equal(state.pose, before.pose)
    _, on = run(localiser, rows[20:21], poses[20:21], state)
    assert not np.array_equal(on.ndt_map, state.ndt_map)
    carried = localiser.reset_pose(on, pose_of((1.0, 2.0, 3.0)))
    assert carried.pose.tolist() == carried.odometry.tolist() == [1.0, 2.0, 3.0]
    assert np.array_equal(carried.wheels.errors, on.wheels.errors)


def test_a_map_without_ndt_cells_is_refused(tmp_path):
    grid = Grid(0, 1, 0, 1, 0.5)
    save_map(tmp_path, torch.ones(2, 2), grid, np.zeros((1, 2)))
    with pytest.raises(InputError, match="localise"):
        NavigatorOptions(known_map=str(tmp_path)).navigator(RIG, 30.0)
    save_map(tmp_path, torch.ones(2, 2), grid, np.zeros((1, 2)), to_sparse(map_of(CORNER)))
    options = NavigatorOptions(known_map=str(tmp_path), map_start="1,2,90")
    assert options.start_pose() == pytest.approx((1.0, 2.0, math.pi / 2))
    localiser = options.navigator(RIG, 30.0).localiser
    assert np.array_equal(localiser.known, map_of(CORNER))


ALONG = np.stack((np.linspace(1.0, 3.0, 161), np.full(161, -1.1)), -1)
ACROSS = np.stack((np.full(97, 3.1), np.linspace(-1.0, 0.2, 97)), -1)
CORNER = np.concatenate((ALONG, ACROSS))
"""Two walls that meet, away from the origin."""


def map_of(points):
    """The NDT map of points of the world."""
    scan = Scan(*points.T.copy(), np.ones(len(points)))
    return add_scan(empty_map(MAP_CELLS), scan, np.zeros(3), CELL_M)


def test_cells_hold_the_moments_of_their_points():
    points = CORNER + np.random.default_rng(2).normal(0, 0.01, CORNER.shape)
    cells = {tuple(cell[:2].astype(int)): cell[2:] for cell in to_sparse(map_of(points))}
    at = np.floor(points / CELL_M).astype(int)
    assert set(cells) == set(map(tuple, at.tolist()))
    for cell, sums in cells.items():
        offset = points[(at == cell).all(1)] - (np.array(cell) + 0.5) * CELL_M
        x, y = offset.T
        wanted = (len(x), x.sum(), y.sum(), (x * x).sum(), (x * y).sum(), (y * y).sum())
        assert sums == pytest.approx(wanted, abs=1e-4)


def test_a_map_is_not_changed_by_adding_a_scan_and_survives_a_file():
    before = map_of(CORNER)
    kept = before.copy()
    after = add_scan(before, Scan(*CORNER.T, np.ones(len(CORNER))), np.array((0.5, 0.2, 0.3)), CELL_M)
    assert np.array_equal(before, kept)
    sparse = to_sparse(after)
    assert np.array_equal(from_sparse(sparse, len(after)), after)
    small = from_sparse(sparse, 24)  # 3 m to each side
    assert 0 < len(to_sparse(small)) < len(sparse)


def test_a_scan_is_matched_to_the_pose_at_which_it_was_taken():
    ends = [
        ((0, 0), (9, 0)),
        ((9, 0), (9, 6)),
        ((9, 6), (0, 6)),
        ((0, 6), (0, 0)),
        ((3, 2), (4, 2.4)),
        ((5, 4), (5, 5)),
    ]
    points = np.concatenate([np.linspace(a, b, int(20 * math.dist(a, b)) + 2) for a, b in ends])
    points, pose = points + np.random.default_rng(4).normal(0, 0.005, points.shape), np.array((4.0, 3.0, 0.7))
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    offset = points[np.hypot(*(points - pose[:2]).T) < 3.5] - pose[:2]
    scan = Scan(offset @ (cos, sin), offset @ (-sin, cos), np.ones(len(offset)))
    match = match_scan(map_of(points), scan, pose + np.array((0.06, -0.05, 0.03)), (0.3, 0.3), CELL_M)
    assert match.pose == pytest.approx(pose, abs=2e-3)
    assert match.score == pytest.approx(0.5, abs=0.2)  # the mean of exp(-d^2 / 2) of a Gaussian


SURE = np.diag(np.square((0.001, 0.0002)))


def roll(wheels, distance, turn):
    """The wheels after they have reported an arc in one step."""
    x, y, heading = map(float, wheels.reported)
    middle = heading + turn / 2
    there = np.array((x + distance * math.cos(middle), y + distance * math.sin(middle), heading + turn))
    return advance(wheels, there, DT)


def taught(steps=150, scale=0.08, bend=0.02, drift=0.003):
    """Wheels that overstate what visual odometry measures."""
    wheels = start_odometry(np.zeros(3))
    for n in range(steps):
        distance, turn = 0.1, 0.08 if n % 20 < 8 else 0.0
        wheels = roll(wheels, distance / (1 - scale), turn / (1 - scale) / (1 - bend) + drift * DT)
        wheels, _ = fuse(wheels, Motion(np.array((distance, turn)), SURE))
    return wheels


def test_the_errors_of_the_wheels_are_learned_and_corrected_without_visual_odometry():
    wheels = taught()
    assert wheels.errors.tolist() == pytest.approx((0.08, 0.02, 0.003), abs=0.004)
    rolled = roll(wheels, 0.1 / 0.92, 0.0)
    assert motion_since_scan(rolled) == pytest.approx((0.1, -0.0005), abs=0.0005)
    blind, variance = fuse(rolled, None)
    assert blind.base == pytest.approx(fused_pose(rolled))
    assert np.array_equal(blind.errors, wheels.errors)
    _, less = fuse(rolled, Motion(motion_since_scan(rolled), SURE))
    assert (less < 0.5 * variance).all()


def test_slip_is_measured_and_not_learned():
    before = taught()
    after, _ = fuse(roll(before, 0.14, 0.035), Motion(np.array((0.09, 0.0)), SURE))
    assert after.base - before.base == pytest.approx(
        (0.09 * math.cos(before.base[2]), 0.09 * math.sin(before.base[2]), 0.0), abs=0.002
    )
    assert after.errors == pytest.approx(before.errors, abs=0.03)
    assert after.since.tolist() == [0, 0, 0]


@pytest.mark.parametrize(("scale", "points"), [(0.0, None), (0.1, None), (-0.3, None), (0.05, 2)])
def test_distance_and_turn_are_measured_in_two_rows(scale, points):
    rig, world, errors = StereoRig(forward=0.15), room(), []
    for n, (distance, turn) in enumerate([(0.1, 0.0), (0.1, 0.09), (0.08, -0.12), (0.12, 0.03), (-0.1, 0.0)] * 4):
        start = (-1.2 + 0.1 * n, -1.0, 0.2 * n)
        poses = [start, arc(Pose(*start), distance, turn / distance, 1.0)]
        # The cameras stand ahead of the point that the arc is driven by.
        eyes = [(x + rig.forward * math.cos(h), y + rig.forward * math.sin(h), h) for x, y, h in poses]
        left, right, _ = world.drive(eyes)
        before, after = np.stack((left, right), 1).astype(np.float32)
        scan = Localiser(rig, DT).scan(before)
        wheels = with_keyframe(start_odometry(np.zeros(3)), before, Scan(*(part[:points] for part in scan)))
        motion = visual_motion(roll(wheels, (1 + scale) * distance, (1 + scale) * turn), after, rig)
        if motion is not None:
            errors.append((motion.mean - (distance, turn), np.sqrt(np.diag(motion.covariance))))
    errors = np.array(errors)
    assert len(errors) > (8 if points else 14)
    # Nearly all lie within three of the standard deviations that it gives.
    assert np.mean(np.abs(errors[:, 0]) < 3 * errors[:, 1]) > 0.9
    assert np.degrees(np.median(np.abs(errors[:, 0, 1]))) < 0.1
    if points is None:
        assert np.median(np.abs(errors[:, 0, 0])) < 0.003
    noise = np.random.default_rng(0).uniform(size=after.shape).astype(np.float32)
    assert visual_motion(wheels, noise, rig) is None
