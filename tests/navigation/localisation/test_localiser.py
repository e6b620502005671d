"""Where the car is, in a small room that is drawn by ray casting: truth that knows nothing of the library."""

import math

import numpy as np
import pytest
import torch

from ndtorch.errors import InputError
from ndtorch.navigation import Pose, StereoRig
from ndtorch.navigation.localisation import Localiser, LocaliserParams
from ndtorch.navigation.localisation.localiser import WORST_DRIFT, WORST_SCALE
from ndtorch.navigation.localisation.walls import Fit, Scan, pack, unpack
from ndtorch.navigation.odometry import arc
from tests.navigation.planar_world import PlanarWorld

pytest.importorskip("numba")

RIG = StereoRig()
DT = 0.2
"""A step for each scan: what is between two scans is odometry alone."""

CORNERS = np.array([(-3, -2.4), (2.6, -2.4), (2.6, 1.2), (1.4, 2.2), (-3, 2.2)], float)
"""A room with one oblique wall."""


def pose_of(values):
    return Pose(*(torch.tensor(float(value)) for value in values))


@pytest.fixture(scope="module")
def drive():
    """True poses of two rounds, what was driven between them, and both rows seen from each."""
    world = PlanarWorld(np.stack((CORNERS, np.roll(CORNERS, -1, 0)), 1), panels=(0.08, 0.5), seed=3)
    poses, driven = [(0.0, -1.2, 0.0)], []
    for _ in range(150):
        driven.append((0.5, 0.9))
        poses.append(arc(*poses[-1], *driven[-1], DT))
    left, right, _ = world.drive(poses)
    return np.array(poses), driven, torch.from_numpy(np.stack((left, right), 1)).float()


def reckon(poses, driven, scale, drift):
    """Where dead reckoning leads that is wrong by a share of the way and by radians a second."""
    found = [tuple(poses[0])]
    for speed, curvature in driven:
        speed, turn = speed * (1 + scale), speed * curvature + drift
        found.append(arc(*found[-1], speed, turn / speed, DT))
    return np.array(found)


def run(localiser, rows, reckoned, state=None, stop=None):
    found = []
    for row, pose in zip(rows[:stop], reckoned[:stop], strict=True):
        state = localiser(row, pose_of(pose), state)
        found.append([float(part) for part in state.pose])
    return np.array(found), state


def test_it_stays_where_it_is_when_dead_reckoning_drifts_away(drive):
    poses, driven, rows = drive
    reckoned = reckon(poses, driven, 0.04, math.radians(0.5))
    away = np.hypot(*(reckoned - poses)[:, :2].T)
    assert away[-1] > 0.25
    localiser = Localiser(RIG, DT, LocaliserParams(every=DT))
    found, state = run(localiser, rows, reckoned)
    error = found - poses
    assert np.median(np.hypot(*error[:, :2].T)) < 0.05
    assert np.hypot(*error[-1, :2]) < 0.25 * away[-1]
    assert abs(error[-1, 2]) < math.radians(2)
    # It has found out what the wheels do: in a car that always turns, bend and drift are one.
    share, bend, drift = state.wheels.errors.tolist()
    turn = 0.5 * 0.9 * DT + math.radians(0.5) * DT
    assert drift * DT + (bend + share) * turn == pytest.approx(math.radians(0.5) * DT, rel=0.3)
    assert share == pytest.approx(0.04 / 1.04, abs=0.015)


def test_a_state_is_left_as_it_was_and_goes_on_the_same(drive):
    poses, driven, rows = drive
    reckoned = reckon(poses, driven, 0.02, 0.0)
    localiser = Localiser(RIG, DT, LocaliserParams(every=DT))
    whole, _ = run(localiser, rows, reckoned, stop=20)
    first, state = run(localiser, rows, reckoned, stop=10)
    before = state.walls.clone()
    second, _ = run(Localiser(RIG, DT, LocaliserParams(every=DT)), rows[10:], reckoned[10:], state, stop=10)
    assert torch.equal(state.walls, before)
    assert np.array_equal(np.concatenate((first, second)), whole)


def test_it_looks_at_the_rows_only_now_and_then(drive):
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
    assert torch.equal(state.walls, before.walls)
    assert all(torch.equal(a, b) for a, b in zip(state.pose, before.pose, strict=True))
    _, on = run(localiser, rows[20:21], reckoned[20:21], state)
    assert not torch.equal(on.walls, state.walls)


def test_walls_are_packed_and_unpacked(drive):
    poses, _, rows = drive
    params = LocaliserParams(every=DT)
    _, state = run(Localiser(RIG, DT, params), rows, poses, stop=5)
    packed = pack(state.walls)
    assert len(packed) > 5
    assert torch.equal(unpack(packed, params), state.walls)
    # The middles of the cells lie on walls.
    middle = (packed[:, :2] + 0.5) * params.cell + packed[:, 3:5] / packed[:, 2:3]
    begin, along = CORNERS, np.roll(CORNERS, -1, 0) - CORNERS
    unit = along / np.hypot(*along.T)[:, None]
    offset = middle.numpy()[:, None] - begin
    aside = np.abs(offset[..., 0] * unit[:, 1] - offset[..., 1] * unit[:, 0]).min(1)
    assert np.median(aside) < 0.03


def test_a_car_that_is_carried_goes_on_from_there(drive):
    poses, _, rows = drive
    localiser = Localiser(RIG, DT, LocaliserParams(every=DT))
    _, state = run(localiser, rows, poses, stop=5)
    put = localiser.put(state, pose_of((1.0, 2.0, 3.0)))
    assert [float(part) for part in put.pose] == [1.0, 2.0, 3.0]
    assert torch.equal(put.walls, state.walls)
    assert put.parts.poses[-1].tolist() == [1.0, 2.0, 3.0]
    assert not put.parts.cells.any()


def test_a_scan_is_fitted_from_as_far_as_the_pose_is_in_doubt(drive, monkeypatch):
    """And the pose and the odometer are corrected by what comes out, within what an odometer can be wrong by."""
    poses, driven, rows = drive
    p = LocaliserParams()
    localiser = Localiser(RIG, DT, p)
    _, state = run(localiser, rows, reckon(poses, driven, 0, 0), stop=8)
    deviations = torch.tensor([0.1, 0.3, 0.02, 0.01, 0.02, 0.03], dtype=torch.float64)
    still = torch.zeros((), dtype=torch.float64)
    state = state._replace(doubt=deviations.square().diag(), way=still, turned=still, unsure=torch.zeros(2))
    asked, fit = [], Fit(0.0, 0.0, 0.0, 0.9, np.array([1e6, 0, 1e6, 0, 0, 1e6]))

    def fitted(walls, scan, start, windows, params):
        asked.append(windows)
        return fit._replace(x=start[0] + 0.01, y=start[1] - 0.02, heading=start[2] + 0.003)

    monkeypatch.setattr("ndtorch.navigation.localisation.localiser.fit_scan", fitted)
    after = localiser.correct(state, localiser.scan(rows[8]))
    place, angle = math.hypot(0.3, p.still), math.hypot(0.02, p.turn_still)
    assert asked == [pytest.approx((p.reach * place + p.floor, p.reach * angle + p.turn_floor))]
    moved = [float(b) - float(a) for a, b in zip(state.pose, after.pose, strict=True)]
    error = 1 / (1e6 * p.trust) + np.square([p.floor, p.floor, p.turn_floor])
    before = np.square([0.1, 0.3, 0.02]) + np.square([p.still, p.still, p.turn_still])
    assert moved == pytest.approx(np.array([0.01, -0.02, 0.003]) * before / (before + error), rel=1e-4)
    assert float(after.score) == 0.9
    assert (after.doubt.diagonal()[:3] < state.doubt.diagonal()[:3]).all()
    for sign in (1, -1):  # an odometer is no worse than it can be
        together = torch.tensor([0.01, 0.0, 0.0, sign, -sign, sign], dtype=torch.float64)
        learned = localiser.correct(state._replace(doubt=together.outer(together)), localiser.scan(rows[8]))
        found = [float(learned.scale), float(learned.bend), float(learned.drift)]
        assert found == [sign * WORST_SCALE, -sign * WORST_SCALE, sign * WORST_DRIFT]
    fit = fit._replace(score=p.worst)
    assert float(localiser.correct(state, localiser.scan(rows[8])).pose.x) != float(state.pose.x)
    fit = fit._replace(score=p.worst - 0.01)  # a bad one corrects nothing
    refused = localiser.correct(state, localiser.scan(rows[8]))
    assert [float(part) for part in refused.pose] == [float(part) for part in state.pose]
    assert (refused.doubt.diagonal()[:3] >= state.doubt.diagonal()[:3]).all()
    assert float(refused.score) == fit.score


def test_two_points_are_no_scan(drive):
    """They correct nothing and are no wall; that the car was there is kept where it is wanted."""
    poses, driven, rows = drive
    localiser = Localiser(RIG, DT, LocaliserParams())
    _, state = run(localiser, rows, reckon(poses, driven, 0, 0), stop=8)
    scan = localiser.scan(rows[8])
    two, three = (Scan(*(part[scan.weight > 0][:n] for part in scan)) for n in (2, 3))
    assert localiser.absorb(state, two) is state
    kept = localiser.absorb(state, two, keep=True)
    assert torch.equal(kept.walls, state.walls)
    assert kept.pose is state.pose
    assert len(kept.parts.scans) == len(state.parts.scans) + 1
    assert not torch.equal(localiser.absorb(state, three).walls, state.walls)


def test_what_it_cannot_do_is_said():
    with pytest.raises(InputError, match="far"):
        LocaliserParams(far=0.5)
    pose = Pose(*(torch.zeros(2) for _ in range(3)))
    with pytest.raises(InputError, match="one car"):
        Localiser(RIG, DT)(torch.zeros(2, 640), pose)
