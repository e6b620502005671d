"""Localisation in a small room drawn by ray casting: truth that knows nothing of the library."""

import math
import pickle
import zlib

import numpy as np
import pytest
import torch

from ndtorch.navigation import Pose, StereoRig
from ndtorch.navigation.localisation import Localiser, LocaliserParams
from ndtorch.navigation.localisation.ndt import distributions, to_sparse
from ndtorch.navigation.odometry import arc
from tests.navigation.localisation.worlds import CORNERS, DT, PARAMS, pose_of
from tests.navigation.planar_world import PlanarWorld

RIG = StereoRig()
EVERY_STEP = LocaliserParams(scan_interval_s=DT)


@pytest.fixture(scope="module")
def drive():
    """True poses of two rounds, what was driven between them, and both rows seen from each."""
    world = PlanarWorld(np.stack((CORNERS, np.roll(CORNERS, -1, 0)), 1), panels=(0.08, 0.5), seed=3)
    poses, driven = [(0.0, -1.2, 0.0)], []
    for _ in range(150):
        driven.append((0.5, 0.9))
        poses.append(arc(Pose(*poses[-1]), *driven[-1], DT))
    left, right, _ = world.drive(poses)
    return np.array(poses), driven, torch.from_numpy(np.stack((left, right), 1)).float()


def reckon(poses, driven, scale, drift):
    """Dead reckoning with an error of scale and a drift, radians/s."""
    found = [tuple(poses[0])]
    for speed, curvature in driven:
        speed, turn = speed * (1 + scale), speed * curvature + drift
        found.append(arc(Pose(*found[-1]), speed, turn / speed, DT))
    return np.array(found)


def run(localiser, rows, reckoned, state=None, stop=None):
    found = []
    for row, pose in zip(rows[:stop], reckoned[:stop], strict=True):
        state = localiser(row, pose_of(pose), state)
        found.append(state.pose)
    return np.array(found), state


def test_it_stays_where_it_is_when_dead_reckoning_drifts_away(drive):
    poses, driven, rows = drive
    reckoned = reckon(poses, driven, 0.04, math.radians(0.5))
    away = np.hypot(*(reckoned - poses)[:, :2].T)
    assert away[-1] > 0.25
    found, state = run(Localiser(RIG, DT, EVERY_STEP), rows, reckoned)
    error = found - poses
    assert np.median(np.hypot(*error[:, :2].T)) < 0.05
    assert np.hypot(*error[-1, :2]) < 0.25 * away[-1]
    assert abs(error[-1, 2]) < math.radians(2)
    # It has calibrated the wheels: in a car that always turns, bend and drift are one.
    scale, bend, drift = state.wheels.errors.tolist()
    turn = 0.5 * 0.9 * DT + math.radians(0.5) * DT
    assert drift * DT + (bend + scale) * turn == pytest.approx(math.radians(0.5) * DT, rel=0.3)
    assert scale == pytest.approx(0.04 / 1.04, abs=0.015)
    # The means of the cells lie on walls.
    begin, along = CORNERS, np.roll(CORNERS, -1, 0) - CORNERS
    unit = along / np.hypot(*along.T)[:, None]
    offset = distributions(state.ndt_map, PARAMS.cell_m)[0][:, None] - begin
    aside = np.abs(offset[..., 0] * unit[:, 1] - offset[..., 1] * unit[:, 0]).min(1)
    assert np.median(aside) < 0.03


def test_one_map_without_loop_closure_is_some_kilobytes(drive):
    poses, driven, rows = drive
    reckoned = reckon(poses, driven, 0.04, math.radians(0.5))
    one_map = LocaliserParams(scan_interval_s=0.2, loop_closure=False)
    found, state = run(Localiser(RIG, DT, one_map), rows, reckoned, stop=100)
    away = [np.hypot(*(path[99] - poses[99])[:2]) for path in (found, reckoned)]
    assert away[0] < 0.5 * away[1]
    assert (state.graph, state.log) == (None, None)
    kept = state._replace(ndt_map=to_sparse(state.ndt_map).astype(np.float32))
    assert len(zlib.compress(pickle.dumps(kept))) < 16_000


def test_a_standing_car_learns_nothing_from_what_it_sees_again(drive):
    poses, driven, rows = drive
    reckoned = reckon(poses, driven, 0.01, 0.0)
    localiser = Localiser(RIG, DT)
    _, before = run(localiser, rows, reckoned, stop=20)
    _, state = run(localiser, rows[19:20].expand(30, 2, -1), reckoned[19:20].repeat(30, 0), before)
    assert np.array_equal(state.ndt_map, before.ndt_map)
    assert np.array_equal(state.pose, before.pose)
    _, on = run(localiser, rows[20:21], reckoned[20:21], state)
    assert not np.array_equal(on.ndt_map, state.ndt_map)
