"""Localisation in a small room drawn by ray casting: truth that knows nothing of the library."""

import math

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Pose, StereoRig
from ndtorch.navigation.localisation import Localiser, LocaliserParams
from ndtorch.navigation.localisation.localiser import MAX_CALIBRATION, SEARCH_SIGMAS
from ndtorch.navigation.localisation.ndt import Scan, ScanMatch, distributions
from ndtorch.navigation.localisation.pose_filter import SIGMA_M, SIGMA_RAD
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


def test_a_state_is_not_changed_and_goes_on_the_same(drive):
    poses, driven, rows = drive
    reckoned = reckon(poses, driven, 0.02, 0.0)
    localiser = Localiser(RIG, DT, EVERY_STEP)
    whole, _ = run(localiser, rows, reckoned, stop=20)
    first, state = run(localiser, rows, reckoned, stop=10)
    before = state.ndt_map.copy()
    second, _ = run(Localiser(RIG, DT, EVERY_STEP), rows[10:], reckoned[10:], state, stop=10)
    assert np.array_equal(state.ndt_map, before)
    assert np.array_equal(np.concatenate((first, second)), whole)


def test_it_takes_a_scan_only_now_and_then(drive):
    poses, _, rows = drive
    localiser = Localiser(RIG, DT / 3)
    state = None
    for n in range(7):
        assert localiser.due(state) == (n % 3 == 0)
        state = localiser(rows[0] if localiser.due(state) else None, pose_of(poses[0]), state)
    with pytest.raises(InputError, match="rows"):
        localiser(None, pose_of(poses[0]))


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


def test_a_car_that_is_carried_goes_on_from_there(drive):
    poses, _, rows = drive
    localiser = Localiser(RIG, DT, EVERY_STEP)
    _, state = run(localiser, rows, poses, stop=5)
    put = localiser.reset_pose(state, pose_of((1.0, 2.0, 3.0)))
    assert put.pose.tolist() == [1.0, 2.0, 3.0]
    assert np.array_equal(put.ndt_map, state.ndt_map)
    assert put.graph.poses[-1].tolist() == [1.0, 2.0, 3.0]
    assert not put.graph.cells.any()


def test_a_scan_is_matched_within_the_uncertainty_of_the_pose(drive, monkeypatch):
    """The match corrects pose and calibration, the latter within its limits."""
    poses, driven, rows = drive
    p, localiser = PARAMS, Localiser(RIG, DT)
    _, state = run(localiser, rows, reckon(poses, driven, 0, 0), stop=8)
    sigma = np.array([0.1, 0.3, 0.02, 0.01, 0.02, 0.03])
    state = state._replace(covariance=np.diag(sigma**2), distance=0.0, heading_travelled=0.0, variance=np.zeros(2))
    asked, match = [], ScanMatch(0.0, 0.0, 0.0, 0.9, np.array([1e6, 0, 1e6, 0, 0, 1e6]))

    def matched(ndt_map, scan, start, sigma, cell_m):
        asked.append(sigma)
        return match._replace(x=start[0] + 0.01, y=start[1] - 0.02, heading=start[2] + 0.003)

    monkeypatch.setattr("ndtorch.navigation.localisation.localiser.match_scan", matched)
    scan = localiser.scan(rows[8].numpy())
    after = localiser.correct(state, scan)
    place, angle = math.hypot(0.3, SIGMA_M), math.hypot(0.02, SIGMA_RAD)
    assert asked == [pytest.approx((SEARCH_SIGMAS * place + p.min_sigma_m, SEARCH_SIGMAS * angle + p.min_sigma_rad))]
    error = 1 / (1e6 * p.information_scale) + np.square([p.min_sigma_m, p.min_sigma_m, p.min_sigma_rad])
    before = np.square([0.1, 0.3, 0.02]) + np.square([SIGMA_M, SIGMA_M, SIGMA_RAD])
    wanted = np.array([0.01, -0.02, 0.003]) * before / (before + error)
    assert after.pose - state.pose == pytest.approx(wanted, rel=1e-4)
    assert after.score == 0.9
    assert (after.covariance.diagonal()[:3] < state.covariance.diagonal()[:3]).all()
    for sign in (1, -1):
        together = np.array([0.01, 0.0, 0.0, sign, -sign, sign])
        learned = localiser.correct(state._replace(covariance=np.outer(together, together)), scan)
        assert learned.calibration.tolist() == (MAX_CALIBRATION * (sign, -sign, sign)).tolist()
    match = match._replace(score=p.min_score)
    assert localiser.correct(state, scan).pose[0] != state.pose[0]
    match = match._replace(score=p.min_score - 0.01)
    refused = localiser.correct(state, scan)
    assert refused.pose is state.pose
    assert (refused.covariance.diagonal()[:3] >= state.covariance.diagonal()[:3]).all()
    assert refused.score == match.score


def test_two_points_are_no_scan(drive):
    poses, driven, rows = drive
    localiser = Localiser(RIG, DT)
    _, state = run(localiser, rows, reckon(poses, driven, 0, 0), stop=8)
    scan = localiser.scan(rows[8].numpy())
    two, three = (Scan(*(part[scan.weight > 0][:n] for part in scan)) for n in (2, 3))
    assert localiser.integrate_scan(state, two) is state
    kept = localiser.integrate_scan(state, two, keep=True)
    assert kept.ndt_map is state.ndt_map
    assert kept.pose is state.pose
    assert len(kept.graph.scans) == len(state.graph.scans) + 1
    assert not np.array_equal(localiser.integrate_scan(state, three).ndt_map, state.ndt_map)


def test_what_it_cannot_do_is_refused():
    with pytest.raises(InputError, match="max_range_m"):
        LocaliserParams(max_range_m=0.5)
    pose = Pose(*(torch.zeros(2) for _ in range(3)))
    with pytest.raises(InputError, match="one car"):
        Localiser(RIG, DT)(torch.zeros(2, 640), pose)
